"""Joins the bus of this machine with those of others, over one TCP port.

Each bridge tells the other which nodes live on its machine and what they want; only that is sent. A message passes
exactly one bridge: one is forwarded only on the machine where it was published, and arrives under its publisher's gid,
number and stamp, so no arrangement of bridges makes a loop, and what comes by two ways is recognised as one. Stamps are
those of the sender's clock; how far the clocks are apart is measured, not mended.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tactile_nodes import messages
from tactile_nodes.bus.bridge.calls import BridgeCalls
from tactile_nodes.bus.bridge.link import Link
from tactile_nodes.bus.bridge.talk import MALFORMED, Choice, ClockOffset, State, fits
from tactile_nodes.bus.protocol import Participant, Reply, ServiceHandler
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import default_qos
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.loop import Loop
from tactile_nodes.bus.zeromq.publishing import ZmqRelay
from tactile_nodes.bus.zeromq.receiving import Key
from tactile_nodes.bus.zeromq.records import Outlet
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import MessageError, ServiceUnavailableError

FORWARDING = '(bridge)'
"""The node under which a bridge receives what it forwards: nobody's wish of its own."""
_LOOK_EVERY_S = 0.1
_SPEAK_EVERY_S = 1.0
_GONE_AFTER_S = 3.5
_AT_ONCE = 64


@dataclass
class Forward:
    """One topic on its way to one peer; what does not fit in the connection waits here, bounded."""

    subscription: Subscription
    unsent: list[Any] | None = None


@dataclass
class Peer:
    """The bridge at the other end."""

    key: bytes
    state: State
    heard_s: float
    clock: ClockOffset = field(default_factory=ClockOffset)
    forwards: dict[str, Forward] = field(default_factory=dict)
    relays: dict[str, ZmqRelay] = field(default_factory=dict)
    words: deque[list[Any]] = field(default_factory=deque)


class Bridge(Loop):
    """Does the work of a bridge in a thread of its own; `close` ends it."""

    def __init__(self, bus: ZmqBus, link: Link, choice: Choice) -> None:
        super().__init__('bridge')
        self.malformed = 0
        self._bus = bus
        self._link = link
        self._choice = choice
        self._peers: dict[bytes, Peer] = {}
        self._spoken: dict[bytes, State] = {}
        self._outlets: dict[str, Outlet] = {}
        self._wishes: set[Key] = set()
        self._look_s = self._speak_s = 0.0
        self._remotes: tuple[Participant, ...] = ()
        self._calls = BridgeCalls()
        self._blocked = False
        link.watch_with(self.watch, self._take_in)
        bus.attach(self)
        self.start()

    @property
    def refused(self) -> int:
        """How often somebody was kept out whose key is not allowed."""
        return self._link.refused

    def connected(self) -> list[tuple[str, ClockOffset]]:
        """The machines at the other end, and how far their clocks are from ours."""
        return [(peer.state.host, peer.clock) for peer in list(self._peers.values())]

    def participants(self) -> tuple[Participant, ...]:
        return self._remotes

    def service(self, name: str, type_name: str) -> ServiceHandler | None:
        for peer in list(self._peers.values()):
            for offer in (offer for far in peer.state.participants for offer in far.services):
                if (offer.name, offer.type_name) == (name, type_name):
                    return self._passing_on(peer, name, type_name)
        return None

    def close(self) -> None:
        """Leave; the others are told."""
        self._bus.attach(None)
        self.stop()

    # --- the loop -------------------------------------------------------------------------------------------

    def wait_ms(self) -> int:
        return 2 if self._blocked else round(_LOOK_EVERY_S * 1000)

    def tick(self) -> None:
        now_s = monotonic_s()
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_EVERY_S
            self._look_around(now_s)
        self._blocked = False
        for peer in self._peers.values():
            self._blocked |= not self._flush(peer)

    def finish(self) -> None:
        for peer in list(self._peers.values()):
            self._link.send(peer.key, [b'bye'])
            self._drop(peer)
        self._link.close()

    def _look_around(self, now_s: float) -> None:
        for peer in [peer for peer in self._peers.values() if now_s - peer.heard_s > _GONE_AFTER_S]:
            self._drop(peer)
        here = self._read_bus()
        for peer in self._peers.values():
            self._adjust(peer)
        due = now_s >= self._speak_s
        self._speak_s = now_s + _SPEAK_EVERY_S if due else self._speak_s
        for key in self._peers.keys() | ({b''} if not self._link.listens else set()):
            self._speak(key, here, due=due)

    def _read_bus(self) -> tuple[Participant, ...]:
        """Who is on this machine; takes in what of theirs may be forwarded, and what they would like to hear."""
        records = self._bus.meeting.look(trusting=True)
        own = self._bus.own_participant()
        here = (own, *(record.participant for record in records))
        wishes = {(end.name, end.type_name) for peer in here for end in peer.subscriptions if end.node != FORWARDING}
        self._wishes = {wish for wish in wishes if fits(wish[0], self._choice.receive)}
        offers = [(own.uid, outlet) for outlet in self._bus.outlets()]
        offers += [(record.participant.uid, outlet) for record in records for outlet in record.outlets]
        self._outlets = {
            outlet.gid: outlet
            for uid, outlet in offers
            # What bears another's gid has come over a bridge already.
            if outlet.gid.partition('.')[0] == uid and fits(outlet.topic, self._choice.send)
        }
        return here

    def _speak(self, key: bytes, here: tuple[Participant, ...], *, due: bool) -> None:
        peer = self._peers.get(key)
        # With the relay's own number: a new relay is a new wish, and is told again what is latched.
        wants = tuple(sorted(f'{gid}/{relay.number}' for gid, relay in peer.relays.items())) if peer else ()
        state = State(self._bus.uid, here[0].host, here, tuple(self._outlets.values()), wants)
        if due or state != self._spoken.get(key):
            stamps = peer.clock.ask(self._bus.clock.now_ns()) if peer else [0, 0, 0]
            if self._link.send(key, [b'state', state.to_json(stamps)]):
                self._spoken[key] = state

    # --- what the peer wants, and what we want of it ---------------------------------------------------------

    def _adjust(self, peer: Peer) -> None:
        """Be ready to repeat what is wished for here; forward what the other side is ready to repeat."""
        given = {out.gid: out for out in peer.state.outlets if (out.topic, out.type_name) in self._wishes}
        for gid in peer.relays.keys() - given.keys():
            peer.relays.pop(gid).close()
        for gid in given.keys() - peer.relays.keys():
            peer.relays[gid] = self._bus.relay(given[gid])
        wanted = {wish: self._outlets.get(wish.partition('/')[0]) for wish in peer.state.wants}
        for wish in [wish for wish in peer.forwards if not wanted.get(wish)]:
            peer.forwards.pop(wish).subscription.close()
        for wish, outlet in wanted.items():
            if outlet is not None and wish not in peer.forwards:
                made = self._bus.follow(outlet, default_qos(outlet.topic), FORWARDING, lambda: self.post(_nothing))
                peer.forwards[wish] = Forward(made)

    def _flush(self, peer: Peer) -> bool:
        """Send what waits, a message of each topic at a time; false when the connection takes no more."""
        while peer.words:
            if not self._link.send(peer.key, peer.words[0]):
                return False
            peer.words.popleft()
        busy = True
        while busy:
            busy = False
            for forward in peer.forwards.values():
                forward.unsent = forward.unsent or _next(forward.subscription)
                if forward.unsent is None:
                    continue
                if not self._link.send(peer.key, forward.unsent):
                    return False
                forward.unsent = None
                busy = True
        return True

    # --- what comes in --------------------------------------------------------------------------------------

    def _take_in(self) -> None:
        for _ in range(_AT_ONCE):
            came = self._link.receive()
            if came is None:
                return
            try:
                self._handle(*came)
            except MALFORMED:
                self.malformed += 1

    def _handle(self, key: bytes, frames: list[bytes]) -> None:
        kind, *rest = frames
        if kind == b'state':
            self._hear_state(key, *rest)
            return
        peer = self._peers[key]
        peer.heard_s = monotonic_s()
        if kind == b'message':
            header = wire.unpack_header(rest[0])
            relay = peer.relays.get(header.gid.decode())
            if relay is not None:
                relay.repeat(header.sequence, header.source_ns, rest[1])
        elif kind == b'call':
            self._calls.answer(self._bus, fits(rest[1].decode(), self._choice.serve), rest, self._sending(peer))
        elif kind == b'answer':
            self._calls.hear(*rest)
        elif kind == b'bye':
            self._drop(peer)
        else:
            raise MessageError(f'{kind!r} is nothing that a bridge says')

    def _hear_state(self, key: bytes, text: bytes) -> None:
        now_ns = self._bus.clock.now_ns()
        state, stamps = State.from_json(text.decode())
        known = self._peers.get(key)
        if known is not None and known.state.uid != state.uid:  # it was started again, and has forgotten everything
            self._drop(known)
            known = None
        peer = self._peers[key] = known or Peer(key, state, 0.0)
        peer.clock.hear(stamps, now_ns)
        peer.heard_s = monotonic_s()
        changed, peer.state = peer.state != state or known is None, state
        if known is None:
            self._speak_s = self._look_s = 0.0
        if changed:
            self._show()
            self._look_s = 0.0

    def _drop(self, peer: Peer) -> None:
        del self._peers[peer.key]
        self._spoken.pop(peer.key, None)
        for forward in peer.forwards.values():
            forward.subscription.close()
        for relay in peer.relays.values():
            relay.close()
        self._calls.lose(peer.key, peer.state.host)
        self._show()

    def _passing_on(self, peer: Peer, name: str, type_name: str) -> ServiceHandler:
        """What passes calls of a service on to the machine at the other end; used by the thread of the bus."""

        def handle(request: Any, reply: Reply) -> None:
            data = messages.encode(request)

            def ask() -> None:
                if self._peers.get(peer.key) is peer:
                    peer.words.append(self._calls.ask(peer.key, name, type_name, data, reply))
                else:
                    reply(ServiceUnavailableError(f'nobody who serves {name} is connected any more'))

            self.post(ask)

        return handle

    def _sending(self, peer: Peer) -> Callable[[list[Any]], None]:
        return lambda frames: self.post(lambda: peer.words.append(frames))

    def _show(self) -> None:
        """Let the nodes of this machine see those of the others."""
        found = {far.uid: far for peer in self._peers.values() for far in peer.state.participants}
        self._remotes = tuple(found.values())
        self._bus.tell()


def _next(subscription: Subscription) -> list[Any] | None:
    received = subscription.take()
    if received is None:
        return None
    key = wire.type_key(received.type_name)
    header = wire.pack_header(received.publisher.encode(), key, received.sequence, received.source_ns)
    return [b'message', header, received.view]


def _nothing() -> None:
    """The loop looks after its topics whenever it is woken."""
