"""The socket that a server listens on."""

from __future__ import annotations

import errno
import socket

from tactile_nodes.errors import AddressInUseError, BusError

TRIES = 20


def listen(address: str, port: int, what: str = 'the page', argument: str = 'page_port:=') -> socket.socket:
    """A listening socket at `port`, or at the next one that is free; 0: at any. `what` it serves is told if it cannot.

    Raises:
        AddressInUseError: twenty in a row are taken.
        BusError: the address is not this machine's, or the port may not be used.
    """
    for wanted in range(port, min(port + TRIES, 65536)) if port else (0,):
        try:
            return _bound(address, wanted)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                reason = error.strerror or error
                raise BusError(f'cannot serve {what} at {address} port {wanted}: {reason}') from error
    raise AddressInUseError(
        f'the ports {port} to {port + TRIES - 1} of {address} are all taken; choose another with {argument}'
    )


def _bound(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ':' in address else socket.AF_INET
    return socket.create_server((address, port), family=family, backlog=64)


def url(bound: socket.socket) -> str:
    """What to open in a browser."""
    host, port = bound.getsockname()[:2]
    shown = {'0.0.0.0': '127.0.0.1', '::': '[::1]'}.get(host, f'[{host}]' if ':' in host else host)  # noqa: S104
    return f'http://{shown}:{port}/'
