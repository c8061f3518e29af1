"""Opens the server, where the extra that it needs is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.foxglove_view.server import FoxgloveServer


def open_server(address: str, port: int, on_interest: Callable[[str], None]) -> FoxgloveServer:
    """Serve at `port`, or the next one that is free; 0: at any.

    Raises:
        AddressInUseError, BusError: it cannot be served there.
        ConfigurationError: Foxglove's library is not installed.
    """
    try:
        from tactile_nodes.foxglove_view.server import FoxgloveServer
    except ImportError as error:
        raise ConfigurationError(
            f'showing topics in Foxglove needs foxglove-sdk ({error}); '
            "install it with: pip install 'tactile_nodes[foxglove]'"
        ) from error
    return FoxgloveServer(address, port, on_interest)
