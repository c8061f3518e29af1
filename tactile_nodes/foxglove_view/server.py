"""Foxglove's WebSocket server: channels with ROS 2's definitions, fed with the bytes that travelled.

It offers no capability: who connects can look, and change nothing. Each viewer has a queue of its own, out of which the
oldest message falls when it is full.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import foxglove

from tactile_nodes import messages
from tactile_nodes.errors import AddressInUseError, BusError
from tactile_nodes.paths import PACKAGE

QUEUE = 32
"""Messages that wait for one viewer: 6 MB of images, of which a viewer that keeps up never sees more than a few."""
TRIES = 20


class FoxgloveServer:
    """Serves at `address`; `on_interest` is called, from any thread, with a topic that is watched from or until now.

    Raises:
        AddressInUseError: twenty ports in a row are taken.
        BusError: the address is not this machine's, or the port may not be used.
    """

    def __init__(self, address: str, port: int, on_interest: Callable[[str], None]) -> None:
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._server = self._opened(address, port, _Listener(on_interest))

    @property
    def port(self) -> int:
        return int(self._server.port)

    @property
    def link(self) -> str:
        """What opens Foxglove on this data."""
        return str(self._server.app_url())

    def offer(self, topic: str, type_name: str) -> None:
        """Show a topic; showing it twice is harmless.

        Raises:
            MessageError: no such type.
        """
        if topic not in self._channels:
            definition = messages.definition(type_name).encode()
            schema = foxglove.Schema(name=type_name, encoding='ros2msg', data=definition)
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema, message_encoding='cdr', context=self._context
            )

    def withdraw(self, topic: str) -> None:
        """Show it no more."""
        self._channels.pop(topic).close()

    def is_watched(self, topic: str) -> bool:
        return bool(self._channels[topic].has_sinks())

    def show(self, topic: str, data: bytes, at_ns: int) -> None:
        """Give one message to all who watch; waits for nobody."""
        self._channels[topic].log(data, log_time=at_ns)

    def close(self) -> None:
        """End, and disconnect those who watch."""
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()
        self._server.stop()

    def _opened(self, address: str, port: int, listener: _Listener) -> Any:
        for wanted in range(port, min(port + TRIES, 65536)) if port else (0,):
            try:
                return foxglove.start_server(
                    name=PACKAGE,
                    host=address,
                    port=wanted,
                    context=self._context,
                    server_listener=listener,
                    message_backlog_size=QUEUE,
                )
            except RuntimeError as error:
                if 'in use' not in str(error):
                    raise BusError(f'cannot serve Foxglove at {address} port {wanted}: {error}') from error
        raise AddressInUseError(
            f'the ports {port} to {port + TRIES - 1} of {address} are all taken; choose another with port:='
        )


class _Listener:
    """Who watches what (`foxglove.websocket.ServerListener`; what else it could be told needs capabilities)."""

    def __init__(self, on_interest: Callable[[str], None]) -> None:
        self._on_interest = on_interest

    def on_subscribe(self, client: Any, channel: Any) -> None:
        del client
        self._on_interest(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        del client
        self._on_interest(channel.topic)
