"""The message classes by their short names: ``types.Image``, ``types.ForceDistribution``, ….

The classes are made on first use from the message definitions. `types.pyi` beside this file describes them for type
checkers; ``python -m reference.stubs`` writes it.
"""

from __future__ import annotations

from typing import Any

from tactile_nodes.messages.codec import message_class
from tactile_nodes.messages.store import short_names


def __getattr__(name: str) -> type[Any]:
    if name not in short_names():
        raise AttributeError(f'there is no message class {name!r}')
    made = globals()[name] = message_class(short_names()[name])  # later accesses find it as a normal attribute
    return made
