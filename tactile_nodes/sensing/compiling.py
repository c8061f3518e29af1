"""Inner loops compiled by numba: who computes by them, and how they come to be compiled.

Objects that know compiled loops are made with `compiled`, true or false, and stay what they are: answers differ in
their last digits.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

from tactile_nodes.errors import ConfigurationError

PARTS = ('response', 'patches', 'stillness', 'pictures', 'axisymmetric', 'field')
"""What is compiled, each by itself, the longest first."""

NOTICE = 'compiling the inner loops, once on this machine: about half a minute; tactile compile does it ahead'
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
            _loaded('every', say)
        return asked
    try:
        _loaded('every', _refuse)
    except _NotCompiledError:
        say(NEXT_TIME)
        _compile_in_background()
        return False
    except ConfigurationError as error:
        warn(f'computing by numpy, which takes several times as long for a frame: {error}')
        return False
    return True


@cache
def compiled_loops() -> ModuleType:
    """`tactile_nodes.sensing.loops.every`: by name, since its parts import numbers of those who call it.

    Raises:
        ConfigurationError: numba cannot compile them.
    """
    return _loaded('every', lambda _: None)


def compile_part(name: str) -> bool:
    """Load one of the `PARTS`, in a process that has not done so; whether it had to be compiled.

    Raises:
        ConfigurationError: numba cannot compile it.
    """
    notices: list[str] = []
    _loaded(name, notices.append)
    return bool(notices)


@contextmanager
def told_of_compiling(tell: Callable[[str], None]) -> Iterator[None]:
    """While this lasts `tell` gets one line, when numba compiles rather than loads what it compiled before."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc, unused-ignore]
        told = False

        def on_start(self, event: object) -> None:
            del event
            if not self.told:
                self.told = True
                tell(NOTICE)

        def on_end(self, event: object) -> None:
            """It will be used in a moment."""

    with event.install_listener('numba:compile', Listener()):
        yield


def can_compile() -> bool:
    """Whether numba is installed."""
    return importlib.util.find_spec('numba') is not None


def _loaded(name: str, tell: Callable[[str], None]) -> ModuleType:
    """Compiled loops; `tell` gets one line if they were not before."""
    try:
        with told_of_compiling(tell):
            return importlib.import_module(f'tactile_nodes.sensing.loops.{name}')
    except (ImportError, OSError, RuntimeError) as error:  # not installed, without LLVM, without a folder to keep them
        raise ConfigurationError(
            f'numba cannot compile the inner loops here ({" ".join(str(error).split())}); '
            'try pip install numba, or set the parameter compiled to false'
        ) from error


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
