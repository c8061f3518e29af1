"""Tasks on the processes of this machine or on a Dask cluster. Each result depends on its job alone.

Results are therefore identical to the bit wherever they are computed, if processors and libraries are alike.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from queue import Empty, Queue
from typing import Any, TypeVar

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.errors import ConfigurationError, from_extra, in_a_line
from tactile_nodes.learning.progress import Progress
from tactile_nodes.npz_files import read_npz, write_npz

Job = TypeVar('Job')
Result = TypeVar('Result')
Arrays = Mapping[str, np.ndarray]

CONNECT_S, WORKERS_S = 10.0, 30.0
LOOK_S = 2.0
"""Interval at which to check for workers while no task ends."""

DaskTimeoutError = asyncio.TimeoutError
"""Before Python 3.11 it is not the builtin `TimeoutError`."""

RETRIES = 3
"""How often a task is given to another worker after its worker was killed."""

_GOES_ON = 'finished work is kept, and the same command continues from there'
_START = 'dask worker {} --no-nanny --nthreads 1'
_SCHEDULER: ContextVar[str] = ContextVar('scheduler', default='')


@contextmanager
def on_cluster(scheduler: str) -> Iterator[None]:
    """Within this block, tasks run on workers of the Dask scheduler at this address; '': on this machine."""
    before = _SCHEDULER.set(scheduler)
    try:
        yield
    finally:
        _SCHEDULER.reset(before)


def make_files(
    make: Callable[[Job], Arrays],
    jobs: Sequence[tuple[Path, Job]],
    processes: int,
    progress: Progress,
    title: str,
    steps: Callable[[Job], int] = lambda _: 1,
) -> None:
    """Make the file of each job that has none yet, or a damaged one, from the arrays that `make` returns for it.

    A file is written as soon as its task is done. Finished work is thus not lost when a worker, this process or the
    scheduler is killed. `progress` shows `steps` steps for each job.

    Raises:
        ConfigurationError: the cluster cannot be used; the message says why.
    """
    missing = [(file, job) for file, job in jobs if not read_npz(file)]
    if not missing:
        return
    with progress.bar(title, sum(steps(job) for _, job in missing)) as bar:
        for number, arrays in done(make, [job for _, job in missing], processes):
            file, job = missing[number]
            write_npz(file, arrays)
            bar.advance(steps(job))


def done(make: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Iterator[tuple[int, Result]]:
    """Results in order of completion, with the job's number, from the cluster or `processes` processes here.

    Raises:
        ConfigurationError: the cluster cannot be used, and the message says why; or processes here are killed again
            and again.
    """
    if scheduler := _SCHEDULER.get():
        yield from _done_on(scheduler, make, jobs)
        return
    if min(processes, len(jobs)) == 1:  # a task may start tasks itself, which a process of a pool cannot do
        yield from ((number, make(job)) for number, job in enumerate(jobs))
        return
    waiting = dict(enumerate(jobs))
    for _ in range(1 + RETRIES):
        for number, result in _done_here(make, waiting, min(processes, len(waiting))):
            del waiting[number]
            yield number, result
        if not waiting:
            return
    raise ConfigurationError(
        f'worker processes were killed {1 + RETRIES} times, probably because memory ran out; use fewer processes; '
        f'{_GOES_ON}'
    )


def _done_here(make: Callable[[Job], Result], jobs: Mapping[int, Job], processes: int) -> Iterator[tuple[int, Result]]:
    """Results of processes of this machine in order of completion. Ends early if one of the processes is killed."""
    ours = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context('spawn'), _begin)
    try:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which processes that start now inherit
        try:
            futures = {pool.submit(make, job): number for number, job in jobs.items()}
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for future in as_completed(futures):
            number = futures.pop(future)  # do not keep results that were handed over
            if not isinstance(future.exception(), BrokenProcessPool):
                yield number, future.result()
    finally:
        for process in set(multiprocessing.active_children()) - ours:
            process.kill()
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """In a new process: Ctrl-C, which reaches the whole process group, is left to the parent. It ends with its parent,
    also if that is killed; else it would wait for tasks for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


def _done_on(scheduler: str, make: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[tuple[int, Result]]:
    with from_extra('cluster', 'work on a cluster'):
        from distributed import CancelledError, Client, KilledWorker
        from distributed.comm.addressing import get_address_host_port
        from distributed.comm.core import CommClosedError
    try:
        get_address_host_port(scheduler, strict=False)  # with an address that is none, a client is begun and hangs
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, DaskTimeoutError, ValueError) as error:
        raise ConfigurationError(
            f'no Dask scheduler answers at {scheduler} ({error}); start one with: dask scheduler'
        ) from error
    with _dask_silent(), client:
        _require_workers(client, scheduler)
        futures = {client.submit(make, job, pure=False, retries=RETRIES): number for number, job in enumerate(jobs)}
        ended: Queue[Any] = Queue()
        for future in futures:
            future.add_done_callback(ended.put)  # type: ignore[no-untyped-call]
        try:
            while futures:
                future = _first(ended, client, scheduler)
                result = _result(future, client, scheduler)
                future.release()  # so that no worker keeps it, and it is not computed again when that worker is killed
                yield futures.pop(future), result
        except RuntimeError as error:
            if 'deserialization' not in str(error):
                raise
            raise ConfigurationError(
                f'the scheduler {scheduler} cannot import {make.__module__}; start it, and its workers, where that is: '
                'for benchmarks in a checkout, with PYTHONPATH=.'
            ) from error
        except KilledWorker as error:
            raise ConfigurationError(
                f'workers ended repeatedly in one task ({in_a_line(error)}); {_GOES_ON}'
            ) from error
        except (CancelledError, CommClosedError) as error:
            raise ConfigurationError(
                f'the connection to the scheduler {scheduler} was lost; start it and its workers again; {_GOES_ON}'
            ) from error


@contextmanager
def _dask_silent() -> Iterator[None]:
    """Within this block Dask logs nothing. It logs tracebacks of errors that it raises as well, and of lost connections
    in which it was just sending."""
    logs = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.split('.')[0] == 'distributed']
    heard = [log for log in logs if not log.disabled]
    for log in heard:
        log.disabled = True
    try:
        yield
    finally:
        for log in heard:
            log.disabled = False


def _first(ended: Queue[Any], client: Any, scheduler: str) -> Any:
    """The next future that ended. There is no time limit while there are workers."""
    while True:
        try:
            return ended.get(timeout=LOOK_S)
        except Empty:
            _await_workers(client, scheduler)


def _result(future: Any, client: Any, scheduler: str) -> Any:
    """What a task returned. It is computed again if the worker that kept it has been killed since."""
    while True:
        try:
            return future.result(timeout=LOOK_S)
        except DaskTimeoutError:
            if future.status == 'error':  # an error of the task itself
                raise
            _await_workers(client, scheduler)


def _await_workers(client: Any, scheduler: str) -> None:
    try:
        if not client.scheduler_info()['workers']:
            client.wait_for_workers(1, timeout=WORKERS_S)
    except DaskTimeoutError as error:
        raise ConfigurationError(
            f'{scheduler} has lost all its workers; start some with: {_START.format(scheduler)}; {_GOES_ON}'
        ) from error
    except OSError as error:
        raise ConfigurationError(f'the scheduler {scheduler} ended ({in_a_line(error)}); {_GOES_ON}') from error


def _require_workers(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except DaskTimeoutError as error:
        raise ConfigurationError(f'{scheduler} has no workers; start some with: {_START.format(scheduler)}') from error
    try:
        versions = set(client.run(_version).values())
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(
            f'workers of {scheduler} cannot import this package ({error}); install version {__version__} for them'
        ) from error
    if versions != {__version__}:
        found = ', '.join(sorted(versions - {__version__}))
        raise ConfigurationError(f'workers of {scheduler} have version {found} of this package, not {__version__}')


def _version() -> str:
    return __version__
