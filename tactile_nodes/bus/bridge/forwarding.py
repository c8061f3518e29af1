"""The two ends of one topic's way between machines: it is received where it is published, and repeated where wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.bridge.talk import MALFORMED, key_of
from tactile_nodes.bus.protocol import Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import default_qos
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.records import Outlet
from tactile_nodes.bus.zeromq.sockets import Longest, longest_message

if TYPE_CHECKING:
    import zenoh

FORWARDING = '(bridge)'
"""The node under which a bridge receives what it forwards: nobody's wish of its own."""
Post = Callable[[Callable[[], None]], None]


def is_large(outlet: Outlet) -> bool:
    """Whether there may be pictures in it."""
    return longest_message(outlet.type_name) == Longest.PICTURE


class Forward:
    """A publisher of this machine: its messages are received here for as long as another machine wants them.

    Those of a latched one always are, and the last is sent again to whoever asks. `look` and `close` are called in the
    bridge's thread, and messages are sent in that of `post`: what is `patient` waits there until the connection takes
    it, while newer ones take the place of those that wait behind it; else what does not fit in is dropped.
    """

    def __init__(self, session: zenoh.Session, bus: ZmqBus, outlet: Outlet, post: Post, *, patient: bool) -> None:
        from zenoh import CongestionControl, Priority

        self.outlet = outlet
        self._bus = bus
        self._post = post
        self._subscription: Subscription | None = None
        self._last: Received | None = None
        key = key_of(bus.uid, 'data', outlet.gid)
        self._publisher = session.declare_publisher(
            key,
            priority=Priority.DATA_LOW if patient else Priority.DATA_HIGH,
            congestion_control=CongestionControl.BLOCK if patient or outlet.latched else CongestionControl.DROP,
        )
        self._queryable = session.declare_queryable(key, lambda _: post(self._send_again)) if outlet.latched else None

    def look(self) -> None:
        """Begin to receive what somebody there wants now, and end with what nobody does."""
        wanted = self.outlet.latched or self._publisher.matching_status.matching
        if wanted and self._subscription is None:
            qos = default_qos(self.outlet.topic)
            self._subscription = self._bus.follow(self.outlet, qos, FORWARDING, lambda: self._post(self._send))
            for _ in range(self._subscription.waiting):  # came before `_send`, in another thread, had the subscription
                self._post(self._send)
        elif not wanted and self._subscription is not None:
            self._subscription.close()
            self._subscription = None

    def close(self) -> None:
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None
        if self._queryable is not None:
            self._queryable.undeclare()
        self._post(self._publisher.undeclare)  # not while it sends

    def _send(self) -> None:
        """Send the message that has come; one, so that each topic has its turn."""
        subscription = self._subscription
        received = subscription.take() if subscription is not None else None
        if received is not None:
            self._last = received if self.outlet.latched else None
            self._put(received)

    def _send_again(self) -> None:
        if self._last is not None and self._subscription is not None:
            self._put(self._last)

    def _put(self, received: Received) -> None:
        key = wire.type_key(received.type_name)
        header = wire.pack_header(received.publisher.encode(), key, received.sequence, received.source_ns)
        self._publisher.put(received.data, attachment=header)


class Repeat:
    """A publisher of another machine, in whose name a relay speaks on this one.

    `count_malformed` is called, from any thread, for each message that is none, or of another version of its type.
    """

    def __init__(
        self, session: zenoh.Session, bus: ZmqBus, uid: str, outlet: Outlet, count_malformed: Callable[[], None]
    ) -> None:
        self._relay = bus.relay(outlet)
        self._type_key = wire.type_key(outlet.type_name)
        self._count_malformed = count_malformed
        key = key_of(uid, 'data', outlet.gid)
        self._subscriber = session.declare_subscriber(key, self._take_in)
        if outlet.latched:
            session.get(key, lambda _: None)  # it is sent again, at the priority of its topic

    def close(self) -> None:
        self._subscriber.undeclare()
        self._relay.close()

    def _take_in(self, sample: Any) -> None:
        try:
            header = wire.unpack_header(sample.attachment.to_bytes())
            if header.type_key != self._type_key:
                raise ValueError('another version of the type')
            self._relay.repeat(header.sequence, header.source_ns, sample.payload.to_bytes())
        except MALFORMED:
            self._count_malformed()
