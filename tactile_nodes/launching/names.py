"""ROS names: joining namespaces, and checking names."""

from __future__ import annotations

import re

from tactile_nodes.launching.template import SubstitutionError

_PART = r'[A-Za-z_][A-Za-z0-9_]*'
_NAMESPACE = re.compile(rf'/|(/{_PART})+')


def joined_namespace(base: str | None, namespace: str | None) -> str | None:
    """A namespace below the pushed one; absolute ones are kept. The result is absolute, or None if neither is given.

    >>> joined_namespace('/skin', 'left'), joined_namespace('skin', '/left'), joined_namespace(None, None)
    ('/skin/left', '/left', None)
    """
    if namespace is None:
        joined = base
    elif not base or namespace.startswith('/'):
        joined = namespace
    else:
        joined = f'{base.rstrip("/")}/{namespace}'
    if joined is None:
        return None
    absolute = joined if joined.startswith('/') else f'/{joined}'
    return absolute.rstrip('/') or '/'


def check_namespace(namespace: str | None) -> None:
    if namespace is not None and not _NAMESPACE.fullmatch(namespace):
        raise SubstitutionError(
            f"'{namespace}' is not a valid namespace: use letters, digits and _, separated by single /"
        )


def check_node_name(name: str) -> None:
    if not re.fullmatch(_PART, name):
        raise SubstitutionError(
            f"'{name}' is not a valid node name: use letters, digits and _, not beginning with a digit"
        )
