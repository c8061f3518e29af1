"""Opens the server, where the library that it needs is installed."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.web import port

if TYPE_CHECKING:
    from tactile_nodes.foxglove_view.server import FoxgloveServer


def open_server(
    address: str,
    first_port: int,
    on_interest: Callable[[str], None],
    complain: Callable[[str], None],
    origins: Collection[str],
    names: Collection[str] = (),
    *,
    guests: bool = False,
) -> FoxgloveServer:
    """Serve at `first_port`, or the next one that is free; 0: at any.

    Raises:
        AddressInUseError, BusError: it cannot be served there.
        ConfigurationError: aiohttp is not installed.
    """
    try:
        from tactile_nodes.foxglove_view.server import FoxgloveServer
    except ImportError as error:
        raise ConfigurationError(
            f'showing topics in Foxglove needs aiohttp ({error}); install it with: pip install aiohttp'
        ) from error
    listening = port.listen(address, first_port, 'Foxglove', 'port:=')
    return FoxgloveServer(listening, on_interest, complain, origins, names, guests=guests)
