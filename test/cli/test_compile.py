"""`tactile compile`: loops are compiled ahead, once."""

from __future__ import annotations

import contextlib
import importlib.util
import queue
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from running_system import wait_until

from tactile_nodes.cli.compile import compile_all
from tactile_nodes.pipeline.loop_choice import NEXT_TIME, _compile_in_background, choose
from tactile_nodes.sensing.compiling import load_compiled

pytestmark = pytest.mark.timeout(400)
needs_numba = pytest.mark.skipif(importlib.util.find_spec('numba') is None, reason='numba is not installed')


@needs_numba
def test_the_second_time_all_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    assert compile_all(('pictures',)).startswith('compiled 1 of 1 parts in ')
    assert compile_all(('pictures',)) == 'all inner loops were already compiled'


@needs_numba
def test_what_was_compiled_ahead_is_used_from_the_first_start_on() -> None:
    load_compiled('every', print)  # as `tactile compile` does part by part
    said: list[str] = []
    assert choose(None, said.append, said.append)
    assert said == []


STARTED = """
from tactile_nodes.pipeline.loop_choice import choose
print(choose(None, print, print))
"""


@needs_numba
def test_else_the_first_start_takes_numpy_and_compiles_at_low_priority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setenv('TACTILE_LAUNCH', 'marked')  # a launch that ends ends what is marked
    started = subprocess.run([sys.executable, '-c', STARTED], capture_output=True, text=True, check=True)
    assert started.stdout.splitlines() == [NEXT_TIME, 'False']
    try:
        wait_until(lambda: any(each.nice() == 19 for each in begun_here(tmp_path)), 60.0)
    finally:
        for process in begun_here(tmp_path):
            compiling = process.children(recursive=True)  # half a minute more, if it outlived its parent
            for each in (process, *compiling):
                each.kill()


def test_what_the_background_cannot_compile_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else each start would promise the next one compiled loops."""
    (tmp_path / 'file').touch()
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'file'))
    warned: queue.SimpleQueue[str] = queue.SimpleQueue()
    _compile_in_background(warned.put)
    assert warned.get(timeout=60).startswith('the inner loops were not compiled (cannot create the cache folder ')


def begun_here(cache: Path) -> list[psutil.Process]:
    """What compiles into a folder of ours."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            environment = process.environ()
            ours = environment.get('XDG_CACHE_HOME') == str(cache) and 'TACTILE_LAUNCH' not in environment
            if ours and '--background' in process.cmdline():
                found.append(process)
    return found
