"""Inner loops compiled by numba.

Objects with compiled loops take `compiled`, true or false, at construction. It cannot be changed later, since results
differ in their last digits.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

from tactile_nodes.errors import ConfigurationError, in_a_line

PARTS = ('response', 'field', 'patches', 'sums', 'stillness', 'weights', 'axisymmetric', 'pictures')
"""Modules that are compiled, each separately, the slowest first."""

NOTICE = 'compiling the inner loops, once per machine: about half a minute; tactile compile does it in advance'


@cache
def compiled_loops() -> ModuleType:
    """`tactile_nodes.sensing.loops.every`, imported by name because its parts import constants of their callers.

    Raises:
        ConfigurationError: numba cannot compile them.
    """
    return load_compiled('every', lambda _: None)


def compile_part(name: str) -> bool:
    """Load one of the `PARTS` in a process that has not loaded it yet; returns whether it had to be compiled.

    Raises:
        ConfigurationError: numba cannot compile it.
    """
    notices: list[str] = []
    load_compiled(name, notices.append)
    return bool(notices)


@contextmanager
def notice_of_compiling(tell: Callable[[str], None]) -> Iterator[None]:
    """Context in which `tell` gets one line if numba compiles instead of loading from its cache."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc, unused-ignore]
        announced = False

        def on_start(self, event: object) -> None:
            del event
            if not self.announced:
                self.announced = True
                tell(NOTICE)

        def on_end(self, event: object) -> None:
            """Nothing to do at the end of a compilation."""

    with event.install_listener('numba:compile', Listener()):
        yield


def can_compile() -> bool:
    """Whether numba is installed."""
    return importlib.util.find_spec('numba') is not None


def load_compiled(name: str, tell: Callable[[str], None]) -> ModuleType:
    """Load one of the `PARTS`, or `every` one; `tell` gets one line if it was not compiled before.

    Raises:
        ConfigurationError: numba cannot compile it.
    """
    try:
        with notice_of_compiling(tell):
            return importlib.import_module(f'tactile_nodes.sensing.loops.{name}')
    except (ImportError, OSError, RuntimeError) as error:  # not installed, no LLVM, or no cache folder
        no_cache = isinstance(error, RuntimeError)
        remedy = 'set NUMBA_CACHE_DIR to a folder that you own' if no_cache else 'try pip install numba'
        raise ConfigurationError(
            f'numba cannot compile the inner loops here ({in_a_line(error)}); '
            f'{remedy}, or set the parameter compiled to false'
        ) from error
