"""Plays a bag: publishes the same bytes with the same time intervals.

Forces of earlier releases are completed: missing fields are marked as unknown.

Offers ``~/pause``, ``~/resume``, ``~/toggle_paused`` and ``~/play_next`` (std_srvs/Trigger). The parameter ``rate`` can
be changed while playing. The node ends after it has played everything.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.playback import Playback
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments, parse_remap
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.priority import overload
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Publisher, Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import BagError, ConfigurationError, TactileError
from tactile_nodes.messages import encode, stamp_ns, time_from_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.sensors import load_hand

MEET_S = 0.3  # time in which a running subscriber connects, if it is not busy
_MEET_AT_MOST_S, _LISTENS_AT_MOST_S = 2.1, 30.0
_REST_S = 0.5  # time for others to process the last message, before a launch ends with this node
_QUIET_S = 1.0  # a topic computed from the bag is complete after this time without a message
_PATIENCE_S = 30.0  # the same while the message for the last image is missing; longer on an overloaded machine
_HEALTH_PERIOD_S = 0.5
_SHORTEST_QUEUE = 100  # a replay must lose nothing, even at ten times the rate


@dataclass(frozen=True)
class PlayerParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    bag: str = parameter('', 'folder, .mcap or .db3 file to play')
    rate: float = parameter(1.0, 'speed; 2.0 is twice as fast', minimum=0.001, maximum=1e6, read_only=False)
    loop: bool = parameter(False, 'start again at the end')
    start_offset: float = parameter(0.0, 'start this many seconds into the bag', minimum=0.0)
    wait_for: str = parameter(
        '',
        'node that must subscribe before playing starts; of several sensors, at least one within 30 s (longer on an '
        'overloaded machine)',
    )
    delay: float = parameter(0.0, 'seconds to wait before playing', minimum=0.0)
    clock_hz: float = parameter(0.0, 'publish the time of the bag on /clock at this rate; 0.0: off', minimum=0.0)
    topics: tuple[str, ...] = parameter(
        (), "topics to play; '*/image_raw' means this topic of every sensor; empty: all"
    )
    topics_if_there: tuple[str, ...] = parameter((), 'further topics, played if the bag holds them')
    remap: tuple[str, ...] = parameter((), 'rules from:=to for topic names')
    paused: bool = parameter(False, 'start paused')
    answer: str = parameter(
        '', "topic computed from the images, or '*/' and its name: the player ends when it has come for the last image"
    )
    most_hz: float = parameter(0.0, 'that of flow_features: the last images may have no answer')
    hand: str = parameter('', 'hand whose images are played: its fps is most_hz')


class PlayerNode(Node):
    """Plays in its own thread, so that services are answered at any time."""

    NAME = 'player'
    PARAMS = PlayerParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # it paces itself, and may publish /clock
        if not self.params.bag:
            raise BagError('no bag to play; set the parameter bag')
        self.reader = BagReader(self.params.bag)
        try:
            self._require_something()
            self._publishers = self._advertise()
            self._answers = dict.fromkeys(self._hear_answers(), 0)  # stamp of the last message (ns)
            most_hz = load_hand(self.params.hand).fps if self.params.hand else self.params.most_hz
        except TactileError:
            self.reader.close()
            raise
        self._apart_ns = NS_PER_S / most_hz if most_hz else 0
        self._last_images: dict[str, BagMessage] = {}  # by sensor
        self._transforms: dict[str, types.TransformStamped] = {}  # by child frame
        self._clock_publisher = self.create_publisher(topics.CLOCK) if self.params.clock_hz > 0 else None
        rate, hz = self.params.rate, self.params.clock_hz
        self.playback = Playback(
            self.reader, self._publishers, self._publish, self.clock, rate=rate, tick=self._tell_time, tick_hz=hz
        )
        if self.params.paused:
            self.playback.pause()
        for act in (self.pause, self.resume, self.toggle_paused, self.play_next):
            self.create_trigger(f'~/{act.__name__}', act)
        self.create_timer(_HEALTH_PERIOD_S, self._report_health)
        self._thread = self.run_beside('bag', self._play)

    def pause(self) -> str:
        self.playback.pause()
        return 'paused'

    def resume(self) -> str:
        self.playback.resume()
        return 'playing'

    def toggle_paused(self) -> str:
        return self.resume() if self.playback.timeline.paused else self.pause()

    def play_next(self) -> str:
        """While paused, publish one more message. Raises BagError if it is not paused."""
        if not self.playback.timeline.paused:
            raise BagError('playing; pause first')
        self.playback.step()
        return 'published one message'

    def on_parameters(self, changed: PlayerParams) -> None:
        self.playback.set_rate(changed.rate)

    def on_close(self) -> None:
        self.playback.stop()
        self._thread.join(timeout=1.0)
        self.reader.close()

    def _require_something(self) -> None:
        lasts_s, offset_s = self.reader.extent.duration_ns / NS_PER_S, self.params.start_offset
        if offset_s > lasts_s:
            raise BagError(f'{self.reader.path} lasts {lasts_s:.1f} s; there is nothing to play after {offset_s:g} s')

    def _advertise(self) -> dict[str, Publisher]:
        rules = tuple(parse_remap(rule) for rule in self.params.remap)
        names = self._played_as = replace(self.names, remaps=(*rules, *self.names.remaps))
        self._wanted = self._named(self.params.topics)
        if unknown := self._wanted - self.reader.topics.keys():
            raise BagError(f'{self.reader.path} holds no {", ".join(sorted(unknown))}{self._others(unknown)}')
        wanted = self._wanted | self._named(self.params.topics_if_there) if self._wanted else self._wanted
        played = [topic for topic in self.reader.topics.values() if self._plays(topic, wanted)]
        for topic in played:
            if topics.in_table(topic.name) is topics.IMAGE:  # else the forces of two sensors would mix
                self.bus.graph().require_unpublished(names.resolve(topic.name))
        return {topic.name: self._publisher(topic, names.resolve(topic.name)) for topic in played}

    def _named(self, names: tuple[str, ...]) -> set[str]:
        """Full names; names with a star are searched in the bag, and kept if nothing matches."""
        found = set[str]()
        for name in names:
            like = fnmatch.filter(self.reader.topics, name) if '*' in name else [self.names.resolve(name)]
            found |= set(like or [name])
        return found

    def _others(self, unknown: set[str]) -> str:
        """For missing topics: which sensors have them."""
        last = {each.rpartition('/')[2] for each in unknown}
        others = sorted(topic for topic in self.reader.topics if topic.rpartition('/')[2] in last)
        if not others:
            return '; see: tactile bag info'
        return f', but {", ".join(others)}; give the sensor (namespace:=), or its hand (tactile launch replay_hand)'

    def _hear_answers(self) -> tuple[Subscription, ...]:
        """One subscription for each sensor with played topics."""
        if not (answer := self.params.answer):
            return ()
        if (topic := topics.in_table(answer)) is None:
            raise ConfigurationError(f'answer: {answer} is not a topic of this package; see docs/topics.md')
        sensors = sorted({each.rpartition('/')[0] for each in self._wanted})
        names = [answer.replace('*', sensor) for sensor in sensors] if '*' in answer else [self.names.resolve(answer)]
        subscriptions = tuple(
            self.bus.subscribe(name, topic.type_name, Qos('latest', 1), self.full_name) for name in names
        )
        self._ends.extend(subscriptions)
        return subscriptions

    def _plays(self, topic: BagTopic, wanted: set[str]) -> bool:
        if not self.reader.counts.get(topic.name) or (wanted and topic.name not in wanted):
            return False
        if topic.name == topics.CLOCK.name and self.params.clock_hz > 0:
            return False  # there is only one clock, and this node publishes it
        known = self.reader.types
        if not known.is_ours(topic.type_name) and not known.is_completed(topic.type_name):
            self.log.warn(f'{topic.name} is not played: {topic.type_name} is unknown here, or has another version')
            return False
        return True

    def _publisher(self, topic: BagTopic, name: str) -> Publisher:
        usual = topics.default_qos(topic.name)
        qos = Qos('queue', max(usual.depth, _SHORTEST_QUEUE), usual.latched or topic.latched)
        made = self.bus.advertise(name, topic.type_name, qos, self.full_name)
        self._ends.append(made)
        return made

    def _play(self) -> None:
        try:
            self.playback.announce(self.params.start_offset)  # a rest image must arrive before the first picture
            self._wait_until_heard()
            self.playback.wait(MEET_S)
            self._wait_until(self._has_met_all, _MEET_AT_MOST_S)
            self.playback.wait(self.params.delay)
            self.playback.run(self.params.start_offset, self.params.loop)
            self._let_others_finish()
        except (OSError, TactileError) as error:
            self.failure = BagError(f'cannot play on {self.params.bag}: {error}')
            self.report('bag', Level.ERROR, str(self.failure))
        for problem in self.reader.problems:
            self.log.warn(problem)
        self.stop()

    def _let_others_finish(self) -> None:
        self.playback.wait(_REST_S)
        silent_s = 0.0 if self._answers else _QUIET_S
        while silent_s < (_PATIENCE_S * overload() if self._unanswered() else _QUIET_S):
            silent_s = 0.0 if self._take_answers() else silent_s + _QUIET_S
            self.playback.wait(_QUIET_S)
        if (missing := self._unanswered()) and not self.playback.stopped:
            self.log.warn(f'{", ".join(missing)}: nothing came for the last images within {silent_s:.0f} s')

    def _take_answers(self) -> bool:
        """Whether messages have come since the last call."""
        came = [(each, received.message) for each in self._answers if (received := each.take()) is not None]
        for each, message in came:
            self._answers[each] = stamp_ns(message.header.stamp)
        return bool(came)

    def _unanswered(self) -> list[str]:
        """The topics that have not come yet for the last image of their sensor."""
        return [
            each.topic
            for each, answered_ns in self._answers.items()
            if (last := self._last_images.get(each.topic.rpartition('/')[0])) is not None
            and answered_ns + self._apart_ns < stamp_ns(self.reader.decode(last).header.stamp)
        ]

    def _wait_until(self, holds: Callable[[], bool], at_most_s: float) -> float:
        """Wait until it holds, longer on an overloaded machine, where others start late. Returns the seconds waited."""
        rounds = 0
        while not holds() and rounds < round(at_most_s * overload() / MEET_S):
            self.playback.wait(MEET_S)
            rounds += 1
        return rounds * MEET_S

    def _wait_until_heard(self) -> None:
        """Wait for the node `wait_for`; with several sensors, for that of each.

        Raises:
            BagError: it does not subscribe, of no sensor: the bag would be played to nobody.
        """
        waited_s = self._wait_until(lambda: not self._unheard(), _LISTENS_AT_MOST_S)
        unheard = self._unheard()
        if not unheard or self.playback.stopped:
            return
        nodes = ', '.join(f'{sensor}/{self.params.wait_for}' for sensor in sorted(unheard))
        text = f'{nodes} did not subscribe within {waited_s:.0f} s'
        if unheard == self._sensors().keys():
            raise BagError(text)
        self.log.warn(f'{text}; the images of the others are played')

    def _sensors(self) -> dict[str, set[str]]:
        """The topics of each sensor under the names that they are played as."""
        found: dict[str, set[str]] = {}
        for topic in self._wanted or self._publishers:
            found.setdefault(topic.rpartition('/')[0], set()).add(self._played_as.resolve(topic))
        return found

    def _unheard(self) -> set[str]:
        """The sensors whose node `wait_for` does not subscribe."""
        if not self.params.wait_for:
            return set()
        ends = self.bus.graph().subscriptions()
        subscribed = {end.name for end in ends if end.node.rpartition('/')[2] == self.params.wait_for}
        return {sensor for sensor, topics_of in self._sensors().items() if not topics_of & subscribed}

    def _has_met_all(self) -> bool:
        """Whether all running subscribers are connected, so that they receive the first message."""
        # A process counts once, however many of its nodes subscribe.
        peers = self.bus.graph().participants
        wanted = [what for peer in peers for what in {(end.name, end.type_name) for end in peer.subscriptions}]
        return all(
            publisher.listeners >= wanted.count((publisher.topic, publisher.type_name))
            for publisher in self._publishers.values()
        )

    def _publish(self, message: BagMessage) -> None:
        self._publishers[message.topic].publish_bytes(self._bytes(message))
        if topics.in_table(message.topic) is topics.IMAGE:
            self._last_images[message.topic.rpartition('/')[0]] = message

    def _bytes(self, message: BagMessage) -> bytes:
        """As recorded; but static transforms of all publishers in one message, as late subscribers get the last."""
        if self.reader.types.is_completed(message.type_name):
            return encode(self.reader.decode(message))
        if message.topic != topics.TF_STATIC.name:
            return message.data
        self._transforms |= {each.child_frame_id: each for each in self.reader.decode(message).transforms}
        return encode(types.TFMessage(transforms=list(self._transforms.values())))

    def _tell_time(self, bag_ns: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(types.Clock(clock=time_from_ns(max(0, bag_ns))))

    def _report_health(self) -> None:
        state = 'paused' if self.playback.timeline.paused else 'playing'
        late_ms = self.playback.latest_ns / 1e6
        count, rate = self.playback.published, self.playback.timeline.rate
        self.report('bag', Level.OK, f'{state} {self.params.bag}', messages=count, rate=rate, latest_ms=late_ms)


main = partial(run_node, PlayerNode)
