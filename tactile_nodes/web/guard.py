"""Which requests the page's server accepts. Functions of the header fields of a request.

Any page in a browser can send requests to the addresses of this machine. Two header fields reveal such requests. The
browser puts the origin of the page into `Origin`. A foreign name that was made to resolve to this machine (DNS
rebinding) appears in `Host`. So `Host` must be an IP address, which cannot be rebound, or a known name. Requests that
act, or that open a WebSocket, must come from our own page. Programs other than browsers can forge both fields;
`accounts` identifies their user.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection
from enum import Enum

_HOST = re.compile(r'(?P<name>\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d{1,5})?', re.ASCII)


class Guests(Enum):
    """What non-owners of a server may do: other users of this machine, and other machines."""

    NONE = 'none'
    WATCH = 'watch'
    ACT = 'act'


def is_known_host(host: str, names: Collection[str] = ()) -> bool:
    """Whether a `Host` header names this machine: an IP address, localhost or one of `names`, with any port.

    >>> is_known_host('127.0.0.1:7470'), is_known_host('localhost:9000'), is_known_host('evil.example:7470')
    (True, True, False)
    >>> is_known_host('robot-2.local', ['Robot-2.local'])
    True
    """
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    name = match['name'].strip('[]').lower()
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == 'localhost' or name in map(str.lower, names)
    return True


def is_own_page(origin: str | None, host: str) -> bool:
    """Whether a request to `host` comes from a page that was loaded from that host.

    >>> is_own_page('http://127.0.0.1:7470', '127.0.0.1:7470'), is_own_page(None, '127.0.0.1:7470')
    (True, False)
    """
    return origin is not None and origin == f'http://{host}'


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach `address`."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == 'localhost'
