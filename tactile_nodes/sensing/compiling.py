"""Inner loops compiled by numba.

Objects that know compiled loops are made with `compiled`, true or false, and stay what they are: answers differ in
their last digits.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

from tactile_nodes.errors import ConfigurationError, in_a_line

PARTS = ('response', 'field', 'patches', 'told', 'stillness', 'weights', 'axisymmetric', 'pictures')
"""What is compiled, each by itself, the longest first."""

NOTICE = 'compiling the inner loops, once per machine: about half a minute; tactile compile does it in advance'


@cache
def compiled_loops() -> ModuleType:
    """`tactile_nodes.sensing.loops.every`: by name, since its parts import numbers of those who call it.

    Raises:
        ConfigurationError: numba cannot compile them.
    """
    return load_compiled('every', lambda _: None)


def compile_part(name: str) -> bool:
    """Load one of the `PARTS`, in a process that has not done so; whether it had to be compiled.

    Raises:
        ConfigurationError: numba cannot compile it.
    """
    notices: list[str] = []
    load_compiled(name, notices.append)
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


def load_compiled(name: str, tell: Callable[[str], None]) -> ModuleType:
    """One of the `PARTS`, or `every` one; `tell` gets one line if it was not compiled before.

    Raises:
        ConfigurationError: numba cannot compile it.
    """
    try:
        with told_of_compiling(tell):
            return importlib.import_module(f'tactile_nodes.sensing.loops.{name}')
    except (ImportError, OSError, RuntimeError) as error:  # not installed, without LLVM, without a folder to keep them
        raise ConfigurationError(
            f'numba cannot compile the inner loops here ({in_a_line(error)}); '
            'try pip install numba, or set the parameter compiled to false'
        ) from error
