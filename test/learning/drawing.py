"""Tasks for the tests of shared work, in a module of their own: a process that draws imports nothing else."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Mapping
from pathlib import Path

import numpy as np

JOBS = list(range(6))


def drawn(seed: int) -> Mapping[str, np.ndarray]:
    """Numbers that follow from a seed."""
    return {'numbers': np.random.default_rng(seed).normal(size=1000)}


def drawn_or_killed(job: tuple[int, str]) -> Mapping[str, np.ndarray]:
    """The same; the first worker that takes the seed 3 is killed in the midst of it."""
    seed, once = job
    if seed == 3 and not Path(once).exists():
        Path(once).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return drawn(seed)


def counted(job: tuple[int, str]) -> Mapping[str, np.ndarray]:
    """The same, each time noted in a folder; the worker of the last seed is killed once all others are written."""
    seed, folder = job
    with (Path(folder) / 'runs').open('a') as runs:
        runs.write(f'{seed} ')
    if seed == JOBS[-1] and not (Path(folder) / 'killed').exists():
        while not all((Path(folder) / f'{each}.npz').exists() for each in JOBS[:-1]):
            threading.Event().wait(0.01)
        threading.Event().wait(0.5)  # what was said of them reaches the scheduler
        (Path(folder) / 'killed').touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return drawn(seed)


def killed(_: int) -> Mapping[str, np.ndarray]:
    """A task that no process outlives, as where memory never suffices."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def held(folder: str) -> None:
    """A task that notes its process and does not end."""
    (Path(folder) / f'{os.getpid()}.pid').touch()
    threading.Event().wait()
