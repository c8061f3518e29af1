"""The protocol between Foxglove and a server: JSON in both directions, and messages in binary.

Only what a viewer needs, which is the same in `foxglove.sdk.v1` and the older `foxglove.websocket.v1`
(github.com/foxglove/foxglove-sdk, ``rust/foxglove/src/protocol``).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from tactile_nodes import messages
from tactile_nodes.errors import MessageError

SUBPROTOCOLS = ('foxglove.sdk.v1', 'foxglove.websocket.v1')
_MESSAGE = struct.Struct('<BIQ')  # kind, subscription, stamp [ns]; then the bytes of the message
_MESSAGE_KIND = 1
_ERROR = 2
_NUMBERS = range(1 << 32)


@dataclass(frozen=True)
class Channel:
    """A topic with its message definition; if it is offered again, it gets another number."""

    number: int
    topic: str
    type_name: str
    definition: str

    @classmethod
    def of(cls, number: int, topic: str, type_name: str) -> Channel:
        """Raises MessageError if there is no such type."""
        return cls(number, topic, type_name, messages.definition(type_name))

    def to_dict(self) -> dict[str, object]:
        return {
            'id': self.number,
            'topic': self.topic,
            'encoding': 'cdr',
            'schemaName': self.type_name,
            'schemaEncoding': 'ros2msg',
            'schema': self.definition,
        }


@dataclass(frozen=True)
class Order:
    """A viewer subscribes to a channel, under its own number; without a channel it unsubscribes."""

    subscription: int
    channel: int | None = None


def greeting(name: str, session: str) -> str:
    """The server's name, without capabilities, so that viewers cannot change anything."""
    return json.dumps({'op': 'serverInfo', 'name': name, 'capabilities': [], 'sessionId': session})


def advertisement(channels: Iterable[Channel]) -> str:
    return json.dumps({'op': 'advertise', 'channels': [each.to_dict() for each in channels]})


def withdrawal(channel: Channel) -> str:
    return json.dumps({'op': 'unadvertise', 'channelIds': [channel.number]})


def complaint(text: str) -> str:
    return json.dumps({'op': 'status', 'level': _ERROR, 'message': text})


def message(subscription: int, at_ns: int, data: bytes | memoryview) -> bytes:
    return _MESSAGE.pack(_MESSAGE_KIND, subscription, at_ns) + data


def orders(text: str) -> list[Order]:
    """The requests in a text from a viewer.

    Raises:
        MessageError: not a request that this server supports.
    """
    try:
        request = json.loads(text)
        if request['op'] == 'subscribe':
            return [Order(_number(each['id']), _number(each['channelId'])) for each in request['subscriptions']]
        if request['op'] == 'unsubscribe':
            return [Order(_number(each)) for each in request['subscriptionIds']]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise MessageError(f'not a valid request: {type(error).__name__}') from error
    raise MessageError('this server only shows topics')


def link(address: str) -> str:
    """The link that opens Foxglove in a browser, connected to the server at `address`."""
    return f'https://app.foxglove.dev?ds=foxglove-websocket&ds.url={quote(address, safe="")}'


def _number(value: Any) -> int:
    if type(value) is not int or value not in _NUMBERS:
        raise ValueError(value)
    return int(value)
