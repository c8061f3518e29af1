"""Whether inner loops run in numpy or compiled by numba; one choice for the whole process, made at its start."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from types import ModuleType

from tactile_nodes.errors import ConfigurationError

PARTS = ('response', 'patches', 'stillness', 'pictures', 'axisymmetric', 'field')
"""What is compiled, each by itself, the longest first."""

NOTICE = 'compiling the inner loops, once on this machine: about half a minute; tactile compile does it ahead'

_chosen: list[ModuleType] = []


def use_compiled(wanted: bool = True, tell: Callable[[str], None] | None = None) -> None:
    """From now on compiled loops, or numpy. The first use on a machine compiles for half a minute; later ones load.

    Answers differ in their last digits, so choose before the first frame. `tell` gets one line when it compiles.

    Raises:
        ConfigurationError: numba is not installed.
    """
    _chosen.clear()
    if not wanted:
        return
    _require_numba()
    with told_of_compiling(tell) if tell else nullcontext():
        _chosen.append(importlib.import_module('tactile_nodes.sensing.loops.every'))


def compiled_loops() -> ModuleType | None:
    """`tactile_nodes.sensing.loops.every` where it is in use; None where numpy is."""
    return _chosen[0] if _chosen else None


def compile_part(name: str) -> bool:
    """Load one of the `PARTS`, in a process that has not done so; whether it had to be compiled.

    Raises:
        ConfigurationError: numba is not installed.
    """
    _require_numba()
    notices: list[str] = []
    with told_of_compiling(notices.append):
        importlib.import_module(f'tactile_nodes.sensing.loops.{name}')
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


def _require_numba() -> None:
    if not can_compile():
        raise ConfigurationError(
            "compiled loops need numba, which is not installed; pip install 'tactile_nodes[compiled]', or set the "
            'parameter compiled to false'
        )
