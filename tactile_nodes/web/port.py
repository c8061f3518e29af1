"""The socket that a server listens on."""

from __future__ import annotations

import errno
import socket

from tactile_nodes.errors import AddressInUseError, BusError

TRIES = 20


def listen(address: str, port: int, purpose: str = 'the page', argument: str = 'page_port:=') -> socket.socket:
    """A listening socket at `port`, or at the next free one; 0: any. `purpose` is named in error messages.

    Raises:
        AddressInUseError: twenty ports in a row are in use.
        BusError: the address does not belong to this machine, or the port is not allowed.
    """
    for wanted in range(port, min(port + TRIES, 65536)) if port else (0,):
        try:
            return _bound(address, wanted)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                reason = error.strerror or error
                raise BusError(f'cannot serve {purpose} on {address} port {wanted}: {reason}') from error
    raise AddressInUseError(
        f'ports {port} to {port + TRIES - 1} of {address} are all in use; choose another with {argument}'
    )


def _bound(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ':' in address else socket.AF_INET
    return socket.create_server((address, port), family=family, backlog=64)


def url(bound: socket.socket) -> str:
    host, port = bound.getsockname()[:2]
    shown = {'0.0.0.0': '127.0.0.1', '::': '[::1]'}.get(host, f'[{host}]' if ':' in host else host)  # noqa: S104
    return f'http://{shown}:{port}/'
