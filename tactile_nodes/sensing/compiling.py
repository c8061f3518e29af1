"""Whether inner loops run in numpy or compiled by numba; one choice for the whole process, made at its start."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from tactile_nodes.errors import ConfigurationError

_chosen: list[ModuleType] = []


def use_compiled(wanted: bool = True) -> None:
    """From now on compiled loops, or numpy. The first use on a machine compiles for half a minute; later ones load.

    Answers differ in their last digits, so choose before the first frame.

    Raises:
        ConfigurationError: numba is not installed.
    """
    _chosen.clear()
    if not wanted:
        return
    if importlib.util.find_spec('numba') is None:
        raise ConfigurationError(
            "compiled loops need numba, which is not installed; pip install 'tactile_nodes[compiled]', or set the "
            'parameter compiled to false'
        )
    _chosen.append(importlib.import_module('tactile_nodes.sensing.loops'))


def compiled_loops() -> ModuleType | None:
    """`tactile_nodes.sensing.loops` where it is in use; None where numpy is."""
    return _chosen[0] if _chosen else None
