"""What a launch starts quickly, what it has started, and what of it is still there when it has ended."""

from __future__ import annotations

import contextlib
from pathlib import Path

import psutil


def processes_of(launcher: int) -> list[psutil.Process]:
    """All below a launcher but those that compile inner loops for the next start: it lets them finish."""
    below = psutil.Process(launcher).children(recursive=True)
    compiling = {pid for each in below if 'compile' in _words(each) for pid in _family(each)}
    return [each for each in below if each.pid not in compiling]


def still_there(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that have not ended."""
    return [each for each in processes if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]


def numpy_only(folder: Path) -> Path:
    """Parameters of a sensor of a hand whose nodes load no compiled loops, which takes each a second."""
    file = folder / 'numpy.yaml'
    file.write_text(
        '/**/camera: {ros__parameters: {crop: 440}}\n'
        '/**/flow_features: {ros__parameters: {compiled: false}}\n'
        '/**/force_estimator: {ros__parameters: {compiled: false}}\n'
    )
    return file


def _words(process: psutil.Process) -> list[str]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.cmdline()
    return []


def _family(process: psutil.Process) -> set[int]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return {process.pid, *(each.pid for each in process.children(recursive=True))}
    return {process.pid}
