"""Who may talk to the page's server. Functions on the words of a request.

Whatever page a browser shows may send requests to this machine's own addresses. Two things betray it: the browser
says in `Origin` whose page it is, and a foreign name that was made to point here (DNS rebinding) stands in `Host`. So
`Host` must be an address, which cannot be made to point elsewhere, or a name that we know; and what acts, or opens a
WebSocket, must come from a page of ours. Programs that are no browser can say what they like in both: whose program it
is, `accounts` finds out.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection
from enum import Enum

_HOST = re.compile(r'(?P<name>\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d{1,5})?', re.ASCII)


class Guests(Enum):
    """What those may who are not the owner of a server: other accounts of this machine, and other machines."""

    NONE = 'none'
    WATCH = 'watch'
    ACT = 'act'


def is_known_host(host: str, names: Collection[str] = ()) -> bool:
    """Whether a `Host` header names this machine: an IP address, localhost or one of `names`; the port is free.

    >>> is_known_host('127.0.0.1:7470'), is_known_host('localhost:9000'), is_known_host('evil.example:7470')
    (True, True, False)
    """
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    name = match['name'].strip('[]').lower()
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == 'localhost' or name in names
    return True


def is_own_page(origin: str | None, host: str) -> bool:
    """Whether a request to `host` comes from a page that was loaded from there.

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
