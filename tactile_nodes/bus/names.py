"""Names of topics, services, nodes and namespaces, as ROS 2 allows them (design.ros2.org, topic and service names)."""

from __future__ import annotations

import re

from tactile_nodes.errors import ConfigurationError

LONGEST = 247
"""Longest full name in characters; DDS allows 255, and ROS 2 adds a prefix of up to eight."""
_WORDS = re.compile(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


def absolute(name: str, kind: str = 'a topic or service') -> str:
    """The full name of `name`; a relative name is put in the root namespace.

    Raises:
        ConfigurationError: ROS 2 would not allow the name, or it is private to a node.

    >>> absolute('image_raw'), absolute('/skin/image_raw')
    ('/image_raw', '/skin/image_raw')
    """
    words = name.removeprefix('/')
    if not _WORDS.fullmatch(words):
        raise ConfigurationError(
            f'{name[:80]!r} is not a valid name of {kind}: words of letters, digits and _ not beginning with a digit, '
            'separated by single slashes'
        )
    if len(words) >= LONGEST:
        raise ConfigurationError(
            f'{name[:40] + "…"!r} is not a valid name of {kind}: it has more than {LONGEST} characters'
        )
    return f'/{words}'


def absolute_namespace(name: str) -> str:
    """The full name of a namespace; '' and '/' are the root.

    Raises:
        ConfigurationError: ROS 2 would not allow the name.

    >>> absolute_namespace('/'), absolute_namespace('skin/left')
    ('/', '/skin/left')
    """
    return absolute(name.rstrip('/'), 'a namespace') if name.strip('/') else '/'
