"""Whether a node computes by compiled loops or by numpy: chosen once, at its start."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.compiling import load_compiled

NEXT_TIME = (
    'the inner loops are not compiled yet, so this run computes by numpy, in several times the time; they are compiled '
    'beside it for the next start. To replay what is recorded now to the last digit: compiled:=false'
)


class _NotCompiledError(Exception):
    """Somebody would have to wait for numba."""


def choose(asked: bool | None, say: Callable[[str], None], warn: Callable[[str], None]) -> bool:
    """Whether a node computes by compiled loops, to be asked once, at its start.

    What was `asked` for is done, even if numba compiles for half a minute. Where nobody asked (None) nobody waits: what
    is not compiled yet is compiled in the background, for the next start; of what cannot be somebody is warned; and
    both times it is numpy.

    Raises:
        ConfigurationError: compiled loops are asked for, and numba cannot compile them.
    """
    if asked is not None:
        if asked:
            load_compiled('every', say)
        return asked
    try:
        load_compiled('every', _refuse)
    except _NotCompiledError:
        say(NEXT_TIME)
        _compile_in_background()
        return False
    except ConfigurationError as error:
        warn(f'computing by numpy, which takes several times as long for a frame: {error}')
        return False
    return True


def _refuse(_: str) -> None:
    raise _NotCompiledError(NEXT_TIME)


def _compile_in_background() -> None:
    """In a process of its own, which a launch that ends lets finish; the thread waits for it: no zombie stays."""
    command = [sys.executable, '-m', 'tactile_nodes', 'compile', '--background']
    environment = {name: value for name, value in os.environ.items() if name != 'TACTILE_LAUNCH'}
    process = subprocess.Popen(
        command,
        env=environment,
        cwd='/',
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    threading.Thread(target=process.wait, daemon=True).start()
