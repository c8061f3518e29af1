"""Libraries that only exports need, imported on demand."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_nodes.errors import from_extra


def require(module: str) -> Any:
    """A module of the extra `export`.

    Raises:
        ConfigurationError: it is not installed.
    """
    with from_extra('export', 'this export'):
        return importlib.import_module(module)
