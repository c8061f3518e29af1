"""The libraries that only exports need, imported when they are."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_nodes.errors import ConfigurationError


def require(module: str) -> Any:
    """A module of the extra `export`.

    Raises:
        ConfigurationError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.partition('.')[0]
        raise ConfigurationError(
            f"this export needs {name} ({error}); install it with: pip install 'tactile_nodes[export]'"
        ) from error
