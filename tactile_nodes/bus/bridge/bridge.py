"""Joins the bus of this machine with those of others, over one TCP port, which Zenoh speaks.

Each bridge tells the others which nodes live on its machine, and declares what is wanted there; Zenoh carries that
alone. A message passes exactly one bridge: one is forwarded only from the machine where it was published, and arrives
under its publisher's gid, number and stamp, so no arrangement of bridges makes a loop, and what comes by two ways is
recognised as one. Stamps are those of the sender's clock; how far the clocks are apart is measured, not mended.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.bridge.calls import CallAnswers, pass_on
from tactile_nodes.bus.bridge.forwarding import FORWARDING, Forward, Repeat, is_large
from tactile_nodes.bus.bridge.talk import (
    EVERYBODY,
    MALFORMED,
    VERSION,
    Choice,
    ClockOffset,
    State,
    bridge_of,
    fits,
    key_of,
)
from tactile_nodes.bus.protocol import Participant, Reply, ServiceHandler
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.loop import Loop
from tactile_nodes.bus.zeromq.receiving import Key
from tactile_nodes.bus.zeromq.records import Outlet
from tactile_nodes.clock import monotonic_s
from tactile_nodes.messages.store import store

if TYPE_CHECKING:
    import zenoh

_CLOSE_WITHIN_S = 0.5
_LOOK_EVERY_S = 0.1
_ASK_EVERY_S = 1.0
_NOW = struct.Struct('<qq')


@dataclass
class Peer:
    """The bridge of another machine, and whom of there we repeat."""

    state: State
    clock: ClockOffset = field(default_factory=ClockOffset)
    repeats: dict[str, Repeat] = field(default_factory=dict)


class Bridge(Loop):
    """Does the work of a bridge in a thread of its own; `close` ends it, and the session that it was given.

    Pictures are sent in another thread, where each waits until the connection takes it: nothing else waits for them.
    """

    def __init__(self, bus: ZmqBus, session: zenoh.Session, choice: Choice) -> None:
        super().__init__('bridge')
        self.malformed = 0
        self.strangers: dict[str, str] = {}
        self._bus = bus
        self._session = session
        self._choice = choice
        self._alive: set[str] = set()
        self._peers: dict[str, Peer] = {}
        self._forwards: dict[str, Forward] = {}
        self._announced: State | None = None
        self._look_s = self._ask_s = 0.0
        self._remotes: tuple[Participant, ...] = ()
        bus.attach(self)
        self._declared = self._declare(CallAnswers(bus, choice.serve))
        self._pictures = Loop('bridge of pictures')
        self._pictures.start()
        self._closing = threading.Thread(target=self._close_session, name='bridge that closes', daemon=True)
        self.start()

    def connected(self) -> list[tuple[str, ClockOffset]]:
        """The machines at the other end, and how far their clocks are from ours."""
        return [(peer.state.host, peer.clock) for peer in list(self._peers.values())]

    def linked(self) -> list[str]:
        """The identities of the sessions that ours is connected to."""
        return [str(each) for each in self._session.info.peers_zid()]

    def participants(self) -> tuple[Participant, ...]:
        return self._remotes

    def service(self, name: str, type_name: str) -> ServiceHandler | None:
        for uid, peer in list(self._peers.items()):
            for offer in (offer for far in peer.state.participants for offer in far.services):
                if (offer.name, offer.type_name) == (name, type_name):
                    return self._passing_on(uid, peer.state.host, (name, type_name))
        return None

    def close(self) -> None:
        """Leave, and inform the others. `closed` says whether all is over, which a silent address may delay."""
        self._bus.attach(None)
        self.stop()

    @property
    def closed(self) -> bool:
        """Whether the session is closed, too, so that its port is free."""
        return not self.is_alive() and not self._closing.is_alive()

    # --- what the others may ask, and what they report; called by Zenoh's threads ------------------------------

    def _declare(self, calls: CallAnswers) -> list[Any]:
        session, uid = self._session, self._bus.uid
        guard, alive = self._guard, session.liveliness()
        return [
            session.declare_queryable(key_of(uid, 'now'), guard(self._tell_now)),
            session.declare_queryable(key_of(uid, 'state'), guard(self._tell_state)),
            session.declare_queryable(key_of(uid, 'call'), guard(calls.answer)),
            session.declare_subscriber(key_of(EVERYBODY, 'state'), guard(self._hear)),
            alive.declare_subscriber(key_of(EVERYBODY, version=EVERYBODY), guard(self._meet), history=True),
            alive.declare_token(key_of(uid)),
        ]

    def _guard(self, handle: Callable[[Any], None]) -> Callable[[Any], None]:
        """Whatever somebody sends, it ends nothing but is counted."""

        def guarded(came: Any) -> None:
            try:
                handle(came)
            except MALFORMED:
                self._count_malformed()

        return guarded

    def _count_malformed(self) -> None:
        self.malformed += 1

    def _tell_now(self, query: zenoh.Query) -> None:
        query.reply(query.key_expr, _NOW.pack(self._bus.clock.now_ns(), self._number))

    def _tell_state(self, query: zenoh.Query) -> None:
        if self._announced is not None:
            query.reply(query.key_expr, self._announced.to_json())

    def _hear(self, sample: zenoh.Sample) -> None:
        _, uid = bridge_of(str(sample.key_expr))
        if uid != self._bus.uid:
            state = State.from_json(sample.payload.to_bytes())
            self.post(lambda: self._know(uid, state))

    def _meet(self, sample: zenoh.Sample) -> None:
        from zenoh import SampleKind

        version, uid = bridge_of(str(sample.key_expr))
        if uid != self._bus.uid:
            came = sample.kind == SampleKind.PUT
            self.post(partial(self._greet if came else self._forget, uid, version))

    # --- the loop -------------------------------------------------------------------------------------------

    def wait_ms(self) -> int:
        return round(_LOOK_EVERY_S * 1000)

    def tick(self) -> None:
        now_s = monotonic_s()
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_EVERY_S
            self._look_around()
        if now_s >= self._ask_s:
            self._ask_s = now_s + _ASK_EVERY_S
            for uid in self._alive:
                self._ask(uid)

    def finish(self) -> None:
        within_s = _CLOSE_WITHIN_S if self._peers else 0.0  # so that they are informed
        for forward in self._forwards.values():
            forward.close()
        for uid in list(self._peers):
            self._forget(uid, VERSION)
        self._closing.start()
        self._closing.join(within_s)

    def _close_session(self) -> None:
        """Zenoh waits until an attempt to connect, or to find out an address, has failed; the node does not."""
        self._session.close()  # ends a picture's waiting
        self._pictures.stop()

    def _greet(self, uid: str, version: str) -> None:
        if version != VERSION:
            self.strangers[uid] = version
            return
        self._alive.add(uid)
        self._ask(uid)

    def _forget(self, uid: str, _version: str) -> None:
        self.strangers.pop(uid, None)
        self._alive.discard(uid)
        peer = self._peers.pop(uid, None)
        for repeat in peer.repeats.values() if peer is not None else ():
            repeat.close()
        self._show()

    def _ask(self, uid: str) -> None:
        """Ask a machine for its state, or, when that is known, for its time and the number of its state.

        A state that is published just when the connection is made may be lost.
        """
        peer = self._peers.get(uid)
        if peer is None:
            self._ask_state(uid)
            return
        asked_ns, clock = self._bus.clock.now_ns(), peer.clock

        def hear_now(sample: zenoh.Sample) -> None:
            theirs_ns, number = _NOW.unpack(sample.payload.to_bytes())
            clock.hear(asked_ns, theirs_ns, self._bus.clock.now_ns())
            if number > peer.state.number:
                self.post(partial(self._ask_state, uid))

        self._session.get(key_of(uid, 'now'), self._answered(hear_now))

    def _ask_state(self, uid: str) -> None:
        self._session.get(key_of(uid, 'state'), self._answered(self._hear))

    def _answered(self, hear: Callable[[zenoh.Sample], None]) -> Callable[[Any], None]:
        return self._guard(lambda reply: hear(reply.ok) if reply.ok is not None else None)

    def _know(self, uid: str, state: State) -> None:
        earlier = self._peers.get(uid)
        if uid in self._alive and (earlier is None or earlier.state.number < state.number):
            self._peers[uid] = Peer(state, earlier.clock, earlier.repeats) if earlier is not None else Peer(state)
            self._show()
            self._look_s = 0.0

    def _show(self) -> None:
        """Let the nodes of this machine see those of the others."""
        found = {far.uid: far for peer in self._peers.values() for far in peer.state.participants}
        self._remotes = tuple(found.values())
        self._bus.tell()

    # --- what is wanted here, and what is had here -----------------------------------------------------------

    def _look_around(self) -> None:
        records = self._bus.meeting.look(trusting=True)
        own = self._bus.own_participant()
        participants = (own, *(record.participant for record in records))
        known = store().fielddefs  # a program that was started later may have further types
        offers = [(own.uid, outlet) for outlet in self._bus.outlets()]
        offers += [(record.participant.uid, outlet) for record in records for outlet in record.outlets]
        outlets = {
            outlet.gid: outlet
            for uid, outlet in offers
            # What bears another's gid has come over a bridge already.
            if outlet.gid.partition('.')[0] == uid
            and outlet.type_name in known
            and fits(outlet.topic, self._choice.send)
        }
        wishes = {
            (end.name, end.type_name)
            for peer in participants
            for end in peer.subscriptions
            if end.node != FORWARDING and end.type_name in known
        }
        for uid, peer in self._peers.items():
            self._repeat(uid, peer, {wish for wish in wishes if fits(wish[0], self._choice.receive)})
        self._forward(outlets)
        self._tell(State(self._number, own.host, participants, tuple(outlets.values())))

    def _repeat(self, uid: str, peer: Peer, wishes: set[Key]) -> None:
        given = {out.gid: out for out in peer.state.outlets if (out.topic, out.type_name) in wishes}
        for gid in peer.repeats.keys() - given.keys():
            peer.repeats.pop(gid).close()
        for gid in given.keys() - peer.repeats.keys():
            peer.repeats[gid] = Repeat(self._session, self._bus, uid, given[gid], self._count_malformed)

    def _forward(self, outlets: dict[str, Outlet]) -> None:
        for gid in [gid for gid, forward in self._forwards.items() if outlets.get(gid) != forward.outlet]:
            self._forwards.pop(gid).close()
        for gid in outlets.keys() - self._forwards.keys():
            large = is_large(outlets[gid])
            post = self._pictures.post if large else self.post
            self._forwards[gid] = Forward(self._session, self._bus, outlets[gid], post, patient=large)
        for forward in self._forwards.values():
            forward.look()

    def _tell(self, state: State) -> None:
        if state != self._announced:
            from zenoh import CongestionControl

            self._announced = state = replace(state, number=state.number + 1)
            key = key_of(self._bus.uid, 'state')
            self._session.put(key, state.to_json(), congestion_control=CongestionControl.BLOCK)

    @property
    def _number(self) -> int:
        """That of the state announced last; 0 before the first."""
        return self._announced.number if self._announced is not None else 0

    def _passing_on(self, uid: str, host: str, service: tuple[str, str]) -> ServiceHandler:
        """What passes calls of a service on to another machine; used by the thread of the bus."""

        def handle(request: Any, reply: Reply) -> None:
            pass_on(self._session, key_of(uid, 'call'), host, service, request, reply)

        return handle
