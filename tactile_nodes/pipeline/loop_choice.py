"""Whether a node computes with compiled loops or with NumPy. It is decided once, at the start."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.compiling import load_compiled

NEXT_TIME = (
    'the inner loops are not compiled yet, so this run uses NumPy and is several times slower; they are compiled in '
    'the background for the next start. To replay a recording of this run to the last digit, use compiled:=false'
)


class _NotCompiledError(Exception):
    """The caller would have to wait for numba."""


def choose(setting: bool | None, say: Callable[[str], None], warn: Callable[[str], None]) -> bool:
    """Whether a node computes with compiled loops; call it once, at the start.

    An explicit `setting` is obeyed, even if numba compiles for half a minute. With None nothing waits. Loops that are
    not compiled yet are compiled in the background, for the next start; loops that cannot be compiled give a warning.
    In both cases the node uses NumPy.

    Raises:
        ConfigurationError: compiled loops were asked for, but numba cannot compile them.
    """
    if setting is not None:
        if setting:
            load_compiled('every', say)
        return setting
    try:
        load_compiled('every', _refuse)
    except _NotCompiledError:
        say(NEXT_TIME)
        _compile_in_background(warn)
        return False
    except ConfigurationError as error:
        warn(f'computing with NumPy, which takes several times as long for a frame: {error}')
        return False
    return True


def _refuse(_: str) -> None:
    raise _NotCompiledError(NEXT_TIME)


def _compile_in_background(warn: Callable[[str], None]) -> None:
    """Compile in a separate process, which outlives the launch. A thread waits for it, and warns if it failed."""
    command = [sys.executable, '-m', 'tactile_nodes', 'compile', '--background']
    environment = {name: value for name, value in os.environ.items() if name != 'TACTILE_LAUNCH'}
    process = subprocess.Popen(
        command,
        env=environment,
        cwd='/',
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )

    def wait() -> None:
        said = process.communicate()[1].splitlines()
        if process.returncode:
            warn(f'the inner loops were not compiled ({said[-1] if said else "it was killed"}); try: tactile compile')

    threading.Thread(target=wait, daemon=True).start()
