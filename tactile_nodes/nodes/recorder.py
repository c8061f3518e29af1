"""Records topics into a bag: the serialized bytes, with capture stamp and time of receipt.

Offers the services ``~/start`` and ``~/stop`` (std_srvs/Trigger).
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tactile_nodes.bag.mcap_file import COMPRESSIONS
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.opening import Arrival, Opening
from tactile_nodes.bag.recording import MB, Tally, TopicFilter, describe, folder_of, free_folder
from tactile_nodes.bag.writer import BagLimits, BagWriter
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Endpoint, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import BagError, BusError, MessageError
from tactile_nodes.params import parameter

LOOK_EVERY_S = 0.1
HEALTH_PERIOD_S = 0.5
PATIENCE_S = 0.5
"""Warn if the disk needs longer than this for the data that is still queued at the end."""
ABSENT_AFTER_S = 5.0
"""How long a named topic may take to be published."""
AWAITED_HZ = 5.0
"""Recording starts when a message has come on every topic of at least this rate, and on each latched topic."""
HELD = 0.5
"""Share of the buffer for a slow disk that messages may fill before recording starts: then they fit into it."""
_RECORDING = 'recording'
_STOPPED = b''
"""What is kept as `_RECORDING` after ``~/stop``; while recording it is the folder."""
_QUEUE = Qos('queue', 2000)  # two seconds of force/torque samples at 1 kHz


@dataclass(frozen=True)
class RecorderParams(NodeParams):
    bag: str = parameter('', 'folder to create; if empty or with a final slash: rosbag2_<date> in it')
    topics: tuple[str, ...] = parameter((), 'topics to record; empty: those marked as recorded in the topic table')
    all: bool = parameter(False, 'record every topic')
    regex: str = parameter('', 'also record topics that match this regular expression')
    exclude: str = parameter('', 'do not record topics that match this regular expression')
    compression: str = parameter('none', 'compression of the chunks', choices=tuple(COMPRESSIONS))
    queue_mb: int = parameter(256, 'buffer for a slow disk, after which messages are dropped [MB]', minimum=1)
    max_file_bytes: int = parameter(0, 'start a new file at this size [bytes]; 0: never', minimum=0)
    max_file_s: float = parameter(0.0, 'start a new file after this time [s]; 0: never', minimum=0.0)
    begins_with: str = parameter(
        '',
        "topic, or '*/' and its name, with whose first message recording starts; if none comes, no bag is written (but "
        'recording starts without it if messages fill half of queue_mb)',
        read_only=True,
    )
    autostart: bool = parameter(True, 'record from the start; otherwise wait for ~/start', read_only=True)


class RecorderNode(Node):
    """Passes received messages to a `BagWriter`, and also subscribes to topics that are published later."""

    NAME = 'recorder'
    PARAMS = RecorderParams
    END_WITHIN_S = 4.8  # data that waits for a slow disk must be written; a launch sends the next signal after 5 s

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # bags hold the host's time
        self.writer: BagWriter | None = None
        self.tally = Tally()
        self.last = 'nothing is being recorded'
        self._ended: dict[str, object] = {}
        self._own: set[str] = set()
        self._opening: Opening | None = None
        self._subscriptions: dict[str, Subscription] = {}
        self._since_ns: dict[str, int] = {}
        self._woken = False
        before = self.kept.get(_RECORDING)
        if before == _STOPPED:
            self.log.info('restarted after ~/stop: records nothing before ~/start')
        elif before is not None:
            folder = self._begin(free_folder(folder_of(self.params.bag)), begins_with='')
            self.log.warn(f'restarted while recording into {before.decode(errors="replace")}: continues in {folder}')
        elif self.params.autostart:
            self.start_recording()
        self.create_trigger('~/start', self.start_recording)
        self.create_trigger('~/stop', self._stop_until_started)
        self.create_timer(LOOK_EVERY_S, self._look)
        self.create_timer(HEALTH_PERIOD_S, self._report_health)

    def start_recording(self) -> str:
        """Start a bag. Raises BagError, ConfigurationError."""
        if self.writer is not None:
            raise BagError(f'{self.writer.folder} is already being recorded; stop it first')
        return f'recording into {self._begin(folder_of(self.params.bag), self._begins_with)}'

    def _begin(self, folder: Path, begins_with: str) -> Path:
        params = self.params
        names = frozenset(self.names.resolve(name) for name in params.topics)
        self._filter = TopicFilter(_in_table, names, params.all, params.regex, params.exclude)
        limits = BagLimits(params.queue_mb * MB, params.max_file_bytes, params.max_file_s)
        self.writer = BagWriter(folder, compression=params.compression, limits=limits)
        self._begun_ns = self.clock.now_ns()
        self.failure, self.tally, self._ended = None, Tally(self._begun_ns, _comes_often), {}
        self.post(self._keep_folder)
        self._opening = Opening(self._begun_ns, begins_with, HELD * params.queue_mb * MB)
        self._look()
        return folder

    def _keep_folder(self) -> None:
        if self.writer is not None:
            self.kept.put(_RECORDING, os.fsencode(self.writer.folder))

    @property
    def recorded_s(self) -> float:
        """How long the bag is so far [s]; 0 until it begins."""
        return 0.0 if self._opening is not None else (self.clock.now_ns() - self.tally.begin_ns) / NS_PER_S

    def _stop_until_started(self) -> str:
        self.post(lambda: self.kept.put(_RECORDING, _STOPPED))  # else `autostart` records after a restart
        return self.stop_recording()

    @property
    def _begins_with(self) -> str:
        named = self.params.begins_with
        return named if not named or named.startswith('*') else self.names.resolve(named)

    def _begin_when_connected(self) -> None:
        opening, writer = self._opening, self.writer
        if opening is None or writer is None or not opening.is_over(self.clock.now_ns()):
            return
        if not opening.has_begun:
            self.log.warn(
                f'recording starts without a message on {self._begins_with}, because messages of more than '
                f'{HELD * self.params.queue_mb:g} MB wait for it (half of queue_mb)'
            )
        elif opening.silent:
            self.log.info(f'recording starts; no message yet on {", ".join(opening.silent)}')
        self._write_what_was_held(opening, writer)

    def _write_what_was_held(self, opening: Opening, writer: BagWriter) -> None:
        self.tally.begin_ns = opening.begin_ns
        self._opening = None
        for arrival, log_ns in opening.release():
            if self.writer is not None:
                self._write(arrival, log_ns, writer)

    def stop_recording(self) -> str:
        """End the bag. Raises BagError if there is none, or if not all of it could be written."""
        if self.writer is None:
            raise BagError('nothing is being recorded')
        self._drain()
        if self._opening is not None and not self._opening.has_begun:
            return self._give_up()
        if self._opening is not None:
            self._write_what_was_held(self._opening, self.writer)
        if self.writer is None:  # the last messages could not be written
            raise self.failure or BagError('nothing was recorded')
        writer = self._let_go()
        if waiting := writer.begin_to_close(PATIENCE_S):
            self.log.warn(
                f'messages that still wait for the disk: {waiting}; they are lost if this ends before they are written'
            )
        try:
            totals = writer.close()
        except BagError as error:
            self._fail(error)
            raise
        silent = sorted(name for name in self._filter.names if not writer.counts[name])
        nothing = f'; no messages on {", ".join(silent)}' if silent else ''
        losses = self.tally.losses(writer.dropped_of, _lost)
        self.last = f'wrote {describe(totals)} into {writer.folder}{nothing}{losses}'
        self._ended = self._figures(writer)
        return self.last

    def _give_up(self) -> str:
        self._opening = None
        self._let_go().discard_empty()
        self.last = f'recorded nothing, because no message came on {self._begins_with}'
        self._ended = {}
        return self.last

    def on_close(self) -> None:
        if self.writer is not None:
            try:
                self.log.info(self.stop_recording())
            except BagError as error:
                self._fail(error)

    def _let_go(self) -> BagWriter:
        assert self.writer is not None
        self._unsubscribe()
        writer, self.writer = self.writer, None
        self.kept.drop(_RECORDING)
        return writer

    def _unsubscribe(self) -> None:
        self._count_foreign()
        for subscription in self._subscriptions.values():
            subscription.close()
        self._subscriptions.clear()

    def _count_foreign(self) -> None:
        self.tally.foreign = Counter({name: each.malformed for name, each in self._subscriptions.items()})

    def _look(self) -> None:
        if self.writer is None:
            return
        if self.writer.failure is not None:
            self._fail(self.writer.failure)
            return
        ends = self.bus.graph().publishers()
        self._own = {end.gid for end in ends if end.node == self.full_name}
        for end in sorted(filter(lambda end: self._filter.takes(end.name), ends), key=lambda end: not end.latched):
            if (recorded := self._subscriptions.get(end.name)) is None:
                self._subscribe(end, self.writer)
            elif recorded.type_name != end.type_name:
                self.tally.other_types.add(f'{end.name} as {end.type_name}')
        self._begin_when_connected()

    def _subscribe(self, end: Endpoint, writer: BagWriter) -> None:
        # Latched messages published before we subscribed are received now; else a bag would begin before its recording.
        self._since_ns[end.name] = self.clock.now_ns() if end.latched else 0
        try:
            depth = topics.default_qos(end.name).depth
            topic = BagTopic.of_type(end.name, end.type_name, depth=depth, latched=end.latched)
            made = self.bus.subscribe(end.name, end.type_name, _QUEUE, self.full_name, self._wake)
        except (BusError, MessageError) as error:  # of a ROS 2 package that is not installed here, for example
            self.log.warn(f'{end.name} is not recorded: {error}', once=end.name)
            return
        writer.add_topic(topic)
        if self._opening is not None:
            self._opening.expect(end.name, latched=end.latched, awaited=end.latched or _comes_often(end.name))
        self._subscriptions[end.name] = made
        self.log.info(f"subscribed to topic '{end.name}'")
        self._wake()

    def _wake(self) -> None:
        if not self._woken:
            self._woken = True
            self.post(self._drain)

    def _drain(self) -> None:
        self._woken = False
        for name, subscription in list(self._subscriptions.items()):
            while self.writer is not None and (received := subscription.take()) is not None:
                self._take_in(name, received, self.writer)

    def _take_in(self, name: str, received: Received, writer: BagWriter) -> None:
        log_ns = max(received.received_ns, self._since_ns[name])
        arrival = Arrival(name, received.publisher, received.sequence, received.source_ns, log_ns, received)
        if self._opening is None:
            self._write(arrival, log_ns, writer)
        elif received.publisher not in self._own:  # messages of this node about connecting are not recorded
            self._opening.hold(arrival, len(received.data))
            self._begin_when_connected()

    def _write(self, arrival: Arrival, log_ns: int, writer: BagWriter) -> None:
        self.tally.note(arrival.topic, arrival.publisher, arrival.sequence, arrival.received_ns)
        try:
            writer.write(arrival.topic, arrival.content.data, log_ns, arrival.source_ns, arrival.sequence)
        except MessageError:
            self.tally.malformed[arrival.topic] += 1
        except BagError as error:
            self._fail(error)

    def _fail(self, error: BagError) -> None:
        self.failure = error
        self._unsubscribe()
        self.writer = self._opening = None
        self.kept.drop(_RECORDING)
        self.report('bag', Level.ERROR, str(error))

    def _absent(self) -> str:
        """Named topics that still have no publisher after the time allowed for it."""
        absent = ', '.join(sorted(self._filter.names - self._subscriptions.keys()))
        is_late = self.clock.now_ns() - self._begun_ns >= ABSENT_AFTER_S * NS_PER_S
        return f'no publisher of {absent}' if absent and is_late else ''

    def _report_health(self) -> None:
        if self.writer is None:
            if self.failure is None:
                level = Level.WARN if self._ended.get('lost') or self.tally.other_types else Level.OK
                self.report('bag', level, self.last, **self._ended)
            return
        self._count_foreign()
        totals, tally = self.writer.totals, self.tally
        complaint = tally.complaint(totals) or self._absent()
        level, text = Level.WARN if complaint else Level.OK, complaint or f'recording into {self.writer.folder}'
        self.report(
            'bag', level, text, seconds=totals.seconds, missed=tally.missed,
            mb_per_s=tally.rate_mb_s(totals, HEALTH_PERIOD_S), dropped=totals.dropped, malformed=tally.unfit,
            **self._figures(self.writer),
        )  # fmt: skip

    def _figures(self, writer: BagWriter) -> dict[str, object]:
        lost = self.tally.lost_of(writer.dropped_of)
        each = ', '.join(f'{topic} {count}' for topic, count in lost.most_common())
        return {
            'bag': writer.folder,
            'messages': writer.totals.messages,
            'lost': lost.total(),
            'lost_of': each,
        }


def _lost(topic: str) -> str:
    """What a bag without some messages of `topic` can still be used for."""
    known = topics.in_table(topic)
    return known.lost if known is not None else topics.Topic.lost


def _in_table(topic: str) -> bool:
    known = topics.in_table(topic)
    return known is not None and known.recorded


def _comes_often(topic: str) -> bool:
    known = topics.in_table(topic)
    return known is not None and (known.rate_hz or 0.0) >= AWAITED_HZ


main = partial(run_node, RecorderNode)
