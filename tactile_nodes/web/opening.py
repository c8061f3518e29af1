"""The way to a running page."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.web import port
from tactile_nodes.web.controls import Outcome
from tactile_nodes.web.guard import Guests

if TYPE_CHECKING:
    from tactile_nodes.web.server import PageServer


def open_page(
    address: str,
    first_port: int,
    act: Callable[[str, bool, str], Outcome],
    changed: Callable[[], None],
    complain: Callable[[str], None],
    guests: Guests = Guests.NONE,
    names: Collection[str] = (),
    viewers: int = 16,
    sensors: Sequence[str] = ('',),
) -> PageServer:
    """A server that serves, at `first_port` or the next one that is free.

    Raises:
        ConfigurationError: aiohttp is not installed.
        BusError: the address or port cannot be used.
    """
    try:
        from tactile_nodes.web.server import PageServer
    except ImportError as error:
        raise ConfigurationError(
            f'the live view in the browser needs aiohttp ({error}); install it with: pip install aiohttp, '
            'or launch without the page: page:=false'
        ) from error
    made = PageServer(port.listen(address, first_port), act, changed, complain, guests, names, viewers, sensors)
    made.start()
    return made
