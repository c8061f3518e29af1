"""Work that is shared out: the same results from processes here and from a cluster, whatever becomes of its workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import psutil
import pytest
from drawing import JOBS, counted, drawn, drawn_or_killed, killed

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import done, make_files, on_cluster

# Not imported here: it takes half a second, in each process that collects the tests.
pytestmark = pytest.mark.skipif(find_spec('distributed') is None, reason='dask.distributed is not installed')


@contextmanager
def started(words: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A program of Dask that can import this folder."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')])
    with subprocess.Popen(words, env={**os.environ, 'PYTHONPATH': path}, stderr=subprocess.DEVNULL) as program:
        try:
            yield program
        finally:
            program.kill()


@contextmanager
def worker_alone(scheduler: str) -> Iterator[None]:
    """A worker that nobody starts again, as `dask worker --no-nanny` is."""
    from distributed import Client

    words = [sys.executable, '-m', 'dask', 'worker', scheduler, '--no-nanny', '--nthreads', '1', '--no-dashboard']
    with started(words), Client(scheduler, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=60)
        client.close()
        yield


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """The address of a scheduler of this machine, with so many workers, as `dask scheduler` and `dask worker` start."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=':0') as made:
        yield made.scheduler_address


@pytest.fixture(scope='module')
def two_workers() -> Iterator[str]:
    with cluster(2) as scheduler:
        yield scheduler


def bytes_of(folder: Path) -> list[bytes]:
    return [np.load(folder / f'{seed}.npz')['numbers'].tobytes() for seed in JOBS]


def test_files_are_the_same_to_the_bit_whatever_made_them(tmp_path: Path, two_workers: str) -> None:
    made = {}
    for name, scheduler, processes in (('one', '', 1), ('two', '', 2), ('cluster', two_workers, 1)):
        folder = tmp_path / name
        folder.mkdir()
        with on_cluster(scheduler):
            make_files(drawn, [(folder / f'{seed}.npz', seed) for seed in JOBS], processes, Progress(), 'drawing')
        made[name] = bytes_of(folder)
    assert made['one'] == made['two'] == made['cluster']
    assert len(set(made['one'])) == len(JOBS)


def test_a_process_of_this_machine_that_is_killed_costs_nothing_but_its_task_once_more(tmp_path: Path) -> None:
    jobs = [(tmp_path / f'{seed}.npz', (seed, str(tmp_path / 'killed'))) for seed in JOBS]
    make_files(drawn_or_killed, jobs, 2, Progress(), 'drawing')
    assert (tmp_path / 'killed').exists()
    assert bytes_of(tmp_path) == [drawn(seed)['numbers'].tobytes() for seed in JOBS]


def test_processes_that_are_killed_again_and_again_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('tactile_nodes.learning.tasks.RETRIES', 0)
    with pytest.raises(
        ConfigurationError, match='worker processes were killed 1 times, probably because memory ran out; use fewer'
    ):
        list(done(killed, JOBS, 2))


def test_processes_end_with_the_one_that_started_them_also_if_that_is_killed(tmp_path: Path) -> None:
    work = (
        'from drawing import held; from tactile_nodes.learning.tasks import done; '
        f'list(done(held, [{str(tmp_path)!r}] * 2, 2))'
    )

    def noted() -> list[int]:
        return [int(file.stem) for file in tmp_path.glob('*.pid')]

    with started([sys.executable, '-c', work]) as program:
        while len(noted()) < 2:
            threading.Event().wait(0.01)
        program.kill()
    processes = [psutil.Process(number) for number in noted() if psutil.pid_exists(number)]
    alive = psutil.wait_procs(processes, timeout=30.0)[1]
    for process in alive:
        process.kill()
    assert not alive


def test_ctrl_c_while_processes_start_is_handled_by_the_one_that_started_them() -> None:
    work = (
        'from tactile_nodes.learning.tasks import done\ntry: list(done(abs, [1, 2], 2))\nexcept KeyboardInterrupt: pass'
    )
    words = [sys.executable, '-c', work]
    with subprocess.Popen(words, stderr=subprocess.PIPE, start_new_session=True, text=True) as process:
        while not any('spawn_main' in ' '.join(each.cmdline()) for each in psutil.Process(process.pid).children()):
            threading.Event().wait(0.001)
        os.killpg(process.pid, signal.SIGINT)
        said = process.communicate(timeout=60)[1]
    assert 'Traceback' not in said


def test_a_worker_that_is_killed_costs_its_task_once_more_and_nothing_that_was_written(
    tmp_path: Path, two_workers: str
) -> None:
    jobs = [(tmp_path / f'{seed}.npz', (seed, str(tmp_path))) for seed in JOBS]
    with on_cluster(two_workers):
        make_files(counted, jobs, 1, Progress(), 'drawing')
    assert sorted((tmp_path / 'runs').read_text().split()) == [*map(str, JOBS), str(JOBS[-1])]
    assert bytes_of(tmp_path) == [drawn(seed)['numbers'].tobytes() for seed in JOBS]


def test_the_death_of_the_last_worker_is_one_sentence_and_the_same_command_goes_on(
    tmp_path: Path, two_workers: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('tactile_nodes.learning.tasks.LOOK_S', 0.1)
    monkeypatch.setattr('tactile_nodes.learning.tasks.WORKERS_S', 0.5)
    jobs = [(tmp_path / f'{seed}.npz', (seed, str(tmp_path))) for seed in JOBS]
    with (
        cluster(0) as scheduler,
        worker_alone(scheduler),
        on_cluster(scheduler),
        pytest.raises(ConfigurationError, match='has lost all its workers; start some with: dask worker tcp'),
    ):
        make_files(counted, jobs, 1, Progress(), 'drawing')
    assert sorted(file.name for file in tmp_path.glob('*.npz')) == [f'{seed}.npz' for seed in JOBS[:-1]]
    with on_cluster(two_workers):
        make_files(counted, jobs, 1, Progress(), 'drawing')
    assert bytes_of(tmp_path) == [drawn(seed)['numbers'].tobytes() for seed in JOBS]


def test_a_scheduler_that_is_killed_is_one_sentence(tmp_path: Path) -> None:
    said = tmp_path / 'address'
    words = [sys.executable, '-m', 'dask', 'scheduler', '--host', '127.0.0.1', '--port', '0', '--no-dashboard']
    program = (
        'import logging, os, sys\nfrom drawing import JOBS, drawn\n'
        'from tactile_nodes.errors import ConfigurationError\n'
        'from tactile_nodes.learning.tasks import done, on_cluster\n'
        'try:\n    with on_cluster(sys.argv[1]):\n'
        '        for _ in done(drawn, JOBS * 50, 1):\n'
        '            os.kill(int(sys.argv[2]), 9)\n'
        '            logging.getLogger("distributed.batched").error("closed")  # as Dask does if it was just sending\n'
        'except (ConfigurationError, ProcessLookupError) as error: print(error)\n'
    )
    with started([*words, '--scheduler-file', str(said)]) as scheduler:
        while not said.exists():
            threading.Event().wait(0.01)
        address = json.loads(said.read_text())['address']
        with worker_alone(address):
            client = [sys.executable, '-c', program, address, str(scheduler.pid)]
            found = subprocess.run(client, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    assert found.stderr == ''
    assert f'the connection to the scheduler {address} was lost; start it and its workers again' in found.stdout


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    jobs = [(tmp_path / f'{seed}.npz', seed) for seed in JOBS]
    for file, _ in jobs[:3]:
        np.savez(file, numbers=np.zeros(3))
    make_files(drawn, jobs, 1, Progress(), 'drawing')
    assert [len(np.load(file)['numbers']) for file, _ in jobs] == [3, 3, 3, 1000, 1000, 1000]


@pytest.mark.parametrize(
    'damaged',
    [
        lambda whole: b'',
        lambda whole: bytes(len(whole)),
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole[:4096] + bytes(512) + whole[4608:],
    ],
)
def test_a_file_that_a_cut_of_power_left_damaged_is_made_again(
    tmp_path: Path, damaged: Callable[[bytes], bytes]
) -> None:
    jobs = [(tmp_path / f'{seed}.npz', seed) for seed in JOBS[:2]]
    make_files(drawn, jobs, 1, Progress(), 'drawing')
    whole = jobs[0][0].read_bytes()
    jobs[0][0].write_bytes(damaged(whole))
    make_files(drawn, jobs, 1, Progress(), 'drawing')
    assert jobs[0][0].read_bytes() == whole


def test_a_scheduler_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('tactile_nodes.learning.tasks.CONNECT_S', 0.5)
    begun_s = monotonic_s()
    with (
        on_cluster('tcp://127.0.0.1:1'),
        pytest.raises(ConfigurationError, match='no Dask scheduler answers at tcp://127'),
    ):
        list(done(drawn, JOBS, 1))
    assert monotonic_s() - begun_s < 20


def test_an_address_that_is_none_is_one_sentence_and_leaves_nothing_to_wait_for() -> None:
    """A client that was begun would be waited for in vain when the process ends, and Python would tell of that."""
    code = (
        'from drawing import JOBS, drawn\nfrom tactile_nodes.learning.tasks import done, on_cluster\n'
        'from tactile_nodes.errors import ConfigurationError\nimport sys\n'
        'for address in "nonsense", "tcp://nonsense", "http://127.0.0.1:80":\n'
        '    try:\n        with on_cluster(address):\n            list(done(drawn, JOBS, 1))\n'
        '    except ConfigurationError as error:\n        print(error, file=sys.stderr)\n'
    )
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')])
    words, environment = [sys.executable, '-c', code], {**os.environ, 'PYTHONPATH': path}
    found = subprocess.run(words, capture_output=True, text=True, env=environment, check=True)
    assert len(found.stderr.splitlines()) == 3
    assert found.stderr.count('no Dask scheduler answers at ') == 3


def test_a_scheduler_without_workers_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('tactile_nodes.learning.tasks.WORKERS_S', 0.5)
    with cluster(0) as scheduler, on_cluster(scheduler), pytest.raises(ConfigurationError, match='has no workers'):
        list(done(drawn, JOBS, 1))


def test_a_client_that_is_killed_loses_nothing_that_was_finished(tmp_path: Path) -> None:
    """Each task writes when it is done; the same command makes the rest."""
    program = (
        'import os, sys\nfrom pathlib import Path\n'
        'from tactile_nodes.learning.progress import Progress\nfrom tactile_nodes.learning import tasks\n'
        'import numpy as np\n'
        'def make(job):\n    return {"numbers": np.full(3, job)}\n'
        'def done(make, jobs, processes):\n    for number, job in enumerate(jobs):\n'
        '        if number == 2: os.kill(os.getpid(), 9)\n        yield number, make(job)\n'
        'tasks.done = done\n'
        f'tasks.make_files(make, [(Path({str(tmp_path)!r}) / f"{{n}}.npz", n) for n in range(6)], 1, Progress(), "x")\n'
    )
    ended = subprocess.run([sys.executable, '-c', program], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert sorted(each.name for each in tmp_path.glob('*.npz')) == ['0.npz', '1.npz']
