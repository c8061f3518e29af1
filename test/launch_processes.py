"""What a launch has started, and what of it is still there when it has ended."""

from __future__ import annotations

import contextlib

import psutil


def processes_of(launcher: int) -> list[psutil.Process]:
    """All below a launcher but those that compile inner loops for the next start: it lets them finish."""
    below = psutil.Process(launcher).children(recursive=True)
    compiling = {pid for each in below if 'compile' in _words(each) for pid in _family(each)}
    return [each for each in below if each.pid not in compiling]


def still_there(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that have not ended."""
    return [each for each in processes if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]


def _words(process: psutil.Process) -> list[str]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.cmdline()
    return []


def _family(process: psutil.Process) -> set[int]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return {process.pid, *(each.pid for each in process.children(recursive=True))}
    return {process.pid}
