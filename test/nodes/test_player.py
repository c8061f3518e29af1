"""The player node: what it publishes, under which names, and how it is steered."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from feeding import START_NS, came, located, taken
from jumping_clock import JumpingClock

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BagError, ConfigurationError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.nodes.player import MEET_S, PlayerNode

STRING = 'std_msgs/msg/String'
COUNT = 5
EARLIER = Path(__file__).parents[2] / 'examples/press_bag'


@pytest.fixture(autouse=True)
def _idle(monkeypatch: pytest.MonkeyPatch) -> None:
    """However busy this computer is."""
    monkeypatch.setattr(os, 'getloadavg', lambda: (0.0, 0.0, 0.0))


@pytest.fixture
def clock() -> JumpingClock:
    return JumpingClock(2 * START_NS)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Five texts on /chatter, 100 ms apart, after one latched text on /rest."""
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic(BagTopic.of_type('/rest', STRING, latched=True))
    writer.add_topic(BagTopic.of_type('/chatter', STRING))
    writer.add_topic(BagTopic('/odd', 'lab_msgs/msg/Odd', 'int32 x'))
    writer.write('/rest', text('rest'), START_NS, START_NS)
    for number in range(COUNT):
        writer.write('/chatter', text(str(number)), START_NS + number * 100_000_000, START_NS)
    writer.write('/odd', bytes(8), START_NS, START_NS)
    writer.close()
    return tmp_path / 'bag'


def text(data: str) -> bytes:
    return messages.encode(types.String(data=data))


@pytest.fixture
def play(bus: InProcessBus, clock: JumpingClock, bag: Path) -> Iterator[Callable[..., PlayerNode]]:
    made: list[PlayerNode] = []

    def make(**values: object) -> PlayerNode:
        made.append(PlayerNode(bus, located(**{'bag': str(bag), **values}), clock))
        return made[-1]

    yield make
    for node in made:
        node.close()


def listen(bus: InProcessBus, topic: str, type_name: str = STRING) -> Subscription:
    return bus.subscribe(topic, type_name, Qos('queue', 100))


def heard(subscription: Subscription) -> list[str]:
    return [each.data for each in taken(subscription)]


NUMBERS = [str(number) for number in range(COUNT)]


def test_pictures_are_not_played_among_those_of_a_camera(bus: InProcessBus, play: Callable[..., PlayerNode]) -> None:
    bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/camera')
    with pytest.raises(ConfigurationError, match=r'^/image_raw is already published by /camera, '):
        play(bag=str(EARLIER))


def test_a_remapped_picture_is_played_beside_a_camera(bus: InProcessBus, play: Callable[..., PlayerNode]) -> None:
    bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/camera')
    play(bag=str(EARLIER), remap=['/image_raw:=/left/image_raw'])


def test_plays_everything_and_ends(bus, play) -> None:
    chatter = listen(bus, '/chatter')
    node = play()
    node.spin()  # returns when all was played
    assert heard(chatter) == NUMBERS
    assert node.playback.published == COUNT + 1


def test_simulated_time_does_not_make_it_wait_for_the_clock_that_it_publishes(bag: Path) -> None:
    # `use_sim_time` for all nodes of a launch reaches the player too.
    bus = InProcessBus()
    chatter = listen(bus, '/chatter')
    node = PlayerNode(bus, located(bag=str(bag), use_sim_time=True, clock_hz=40.0, rate=10.0))
    spinning = threading.Thread(target=node.spin, daemon=True)
    spinning.start()
    spinning.join(10.0)
    assert heard(chatter) == NUMBERS
    node.close()
    bus.close()


class Answers(JumpingClock):
    """Others publish a force of each of these times, one after another."""

    def __init__(self, bus: InProcessBus, topic: str, stamps_ns: list[int], each_s: float) -> None:
        super().__init__(2 * START_NS)
        self.left = stamps_ns
        self._publisher = bus.advertise(topic, topics.FORCE_DISTRIBUTION.type_name, topics.FORCE_DISTRIBUTION.qos)
        self._each_ns, self._next_ns = round(each_s * NS_PER_S), self.now_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        super().sleep_until(deadline_ns)
        if self.left and self.now_ns() >= self._next_ns:
            self._next_ns = self.now_ns() + self._each_ns
            stamp = messages.time_from_ns(self.left.pop(0))
            self._publisher.publish(types.ForceDistribution(header=types.Header(stamp=stamp)))


def test_a_player_waits_until_what_follows_from_the_bag_has_come(bus: InProcessBus, bag: Path) -> None:
    """A busy machine computes forces long after the last picture; what is not waited for is lost."""
    clock = Answers(bus, '/force_distribution', [0] * 30, 0.8)
    node = PlayerNode(bus, located(bag=str(bag), answer='/force_distribution'), clock)
    node.spin()
    node.close()
    assert clock.left == []


@pytest.mark.parametrize(
    ('answered', 'skipping', 'said'),
    [
        (COUNT, {}, ''),
        (1, {}, '/left/force_distribution: nothing came for the last images within 30 s'),
        (1, {'most_hz': 1.0}, ''),  # those of the same second are skipped
        (1, {'hand': 'hand.yaml'}, ''),  # so they are here
    ],
)
def test_a_player_waits_for_the_force_of_the_last_picture(
    bus: InProcessBus,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    answered: int,
    skipping: dict[str, Any],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('hand.yaml').write_text('{fps: 1.0, sensors: [{name: left}]}', encoding='utf-8')
    stamps_ns = [START_NS + number * 100_000_000 for number in range(COUNT)]
    writer = BagWriter(tmp_path / 'images')
    writer.add_topic(BagTopic.of_type('/left/image_raw', topics.IMAGE.type_name))
    for at_ns in stamps_ns:
        header = types.Header(stamp=messages.time_from_ns(at_ns))
        writer.write('/left/image_raw', messages.encode(types.Image(header=header)), at_ns, at_ns)
    writer.close()
    values = {'bag': str(tmp_path / 'images'), 'topics': ['*/image_raw'], 'answer': '*/force_distribution'}
    clock = Answers(bus, '/left/force_distribution', stamps_ns[: answered : COUNT - 1], 10.0)
    node = PlayerNode(bus, located(**values, **skipping), clock)
    node.spin()
    node.close()
    assert clock.left == []
    assert said in capsys.readouterr().err if said else 'nothing came' not in capsys.readouterr().err


class LateListener(JumpingClock):
    """A node that takes so many seconds to start."""

    def __init__(self, bus: InProcessBus, late_s: int) -> None:
        super().__init__(2 * START_NS)
        self._bus, self._from_ns = bus, self.now_ns() + late_s * 1_000_000_000
        self.chatter: Subscription | None = None

    def sleep_until(self, deadline_ns: int) -> None:
        super().sleep_until(deadline_ns)
        if self.chatter is None and self.now_ns() >= self._from_ns:
            self.chatter = self._bus.subscribe('/chatter', STRING, Qos('queue', 100), '/flow_features')


@pytest.mark.parametrize(('programs', 'late_s'), [(0, 5), (4, 110)])
def test_a_player_waits_for_the_node_that_has_to_listen(
    bus: InProcessBus, bag: Path, monkeypatch: pytest.MonkeyPatch, programs: int, late_s: int
) -> None:
    """For up to 30 s, and four times as long with four programs a processor."""
    monkeypatch.setattr(os, 'getloadavg', lambda: (programs * len(os.sched_getaffinity(0)), 0.0, 0.0))
    clock = LateListener(bus, late_s)
    node = PlayerNode(bus, located(bag=str(bag), wait_for='flow_features'), clock)
    node.spin()
    node.close()
    assert clock.chatter is not None
    assert heard(clock.chatter) == NUMBERS


def test_a_player_that_only_the_node_of_another_sensor_hears_says_so_instead_of_playing(
    bus: InProcessBus, play: Callable[..., PlayerNode]
) -> None:
    """A hand runs while the recording of a single sensor is played beside it: its nodes do not hear that."""
    bus.subscribe('/left/chatter', STRING, Qos('queue', 100), '/left/flow_features')
    chatter = listen(bus, '/chatter')
    node = play(wait_for='flow_features')
    node.spin()
    assert str(node.failure).endswith('/flow_features did not subscribe within 30 s')
    assert heard(chatter) == []


class EndedEarly(JumpingClock):
    """The player is asked to end while it waits for the first time."""

    def __init__(self) -> None:
        super().__init__(2 * START_NS)
        self.made = threading.Event()
        self.node: PlayerNode | None = None

    def sleep_until(self, deadline_ns: int) -> None:
        self.made.wait()
        assert self.node is not None
        self.node.playback.stop()
        super().sleep_until(deadline_ns)


def test_a_player_that_is_ended_while_it_waits_has_not_failed(bus: InProcessBus, bag: Path) -> None:
    clock = EndedEarly()
    clock.node = PlayerNode(bus, located(bag=str(bag), wait_for='flow_features'), clock)
    clock.made.set()
    clock.node.spin()
    clock.node.close()
    assert clock.node.failure is None


def test_one_sensor_of_a_hand_that_cannot_start_leaves_the_others_their_images(
    bus: InProcessBus, play: Callable[..., PlayerNode], tmp_path: Path
) -> None:
    writer = BagWriter(tmp_path / 'hand')
    for name in ('/left/chatter', '/right/chatter'):
        writer.add_topic(BagTopic.of_type(name, STRING))
        writer.write(name, text('seen'), START_NS, START_NS)
    writer.close()
    left = bus.subscribe('/left/chatter', STRING, Qos('queue', 100), '/left/flow_features')
    logged = listen(bus, topics.ROSOUT.name, topics.ROSOUT.type_name)
    node = play(bag=str(tmp_path / 'hand'), wait_for='flow_features')
    node.spin()
    assert node.failure is None
    assert heard(left) == ['seen']
    received = came(logged)
    assert received.msg.startswith('/right/flow_features did not subscribe within 30 s')


def test_an_answer_of_no_known_topic_is_refused(play) -> None:
    with pytest.raises(ConfigurationError, match='answer: /chatter is not a topic'):
        play(answer='/chatter')


def test_messages_leave_when_they_are_due(bus, play, clock: JumpingClock) -> None:
    chatter = listen(bus, '/chatter')
    begin_ns = clock.now_ns() + round(MEET_S * 1e9)
    play(rate=2.0).spin()
    sent = [chatter.take().source_ns - begin_ns for _ in range(COUNT)]
    assert sent == [number * 50_000_000 for number in range(COUNT)]


def test_who_comes_late_gets_the_transforms_of_all_publishers(bus, play, tmp_path) -> None:
    """A bag does not tell publishers apart, and of each publisher of the bus the last message is kept."""
    writer = BagWriter(tmp_path / 'tf')
    writer.add_topic(BagTopic.of_type('/tf_static', topics.TF_STATIC.type_name, latched=True))
    for number, (frame, x) in enumerate([('arm', 1.0), ('camera', 2.0), ('arm', 3.0)]):
        transform = types.Transform(translation=types.Vector3(x=x))
        told = types.TFMessage(transforms=[types.TransformStamped(child_frame_id=frame, transform=transform)])
        writer.write('/tf_static', messages.encode(told), START_NS + number, START_NS)
    writer.close()
    play(bag=str(tmp_path / 'tf')).spin()
    found = bus.subscribe('/tf_static', topics.TF_STATIC.type_name, topics.TF_STATIC.qos).take().message.transforms
    assert {each.child_frame_id: each.transform.translation.x for each in found} == {'arm': 3.0, 'camera': 2.0}


@pytest.mark.parametrize('start_offset', [0.0, 0.25])
def test_latched_topic_is_latched_again_also_one_of_before_the_start(bus, play, start_offset: float) -> None:
    play(start_offset=start_offset).spin()
    assert heard(listen(bus, '/rest')) == ['rest']


def test_type_that_is_unknown_here_is_left_out_and_reported(play, capsys: pytest.CaptureFixture[str]) -> None:
    play().spin()
    assert '/odd is not played: lab_msgs/msg/Odd is unknown here' in capsys.readouterr().err


def test_forces_of_an_earlier_release_are_played_as_those_of_this_one(bus, play) -> None:
    forces = listen(bus, '/force_distribution', topics.FORCE_DISTRIBUTION.type_name)
    play(bag=str(EARLIER), topics=['/force_distribution']).spin()
    played = taken(forces)
    assert len(played) == 25
    assert max(each.total for each in played) > 0.1
    assert all(math.isnan(contact.shear_x) for each in played for contact in each.contacts)


def test_plays_only_the_topics_it_is_given_under_their_new_names(bus, play) -> None:
    rest, again = listen(bus, '/rest'), listen(bus, '/again')
    play(topics=['/chatter'], remap=['/chatter:=/again']).spin()
    assert (heard(rest), heard(again)) == ([], NUMBERS)


def test_a_bag_of_a_hand_names_its_sensors_to_who_replays_it_as_one(play, tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / 'hand')
    for name in ('/left/chatter', '/right/chatter'):
        writer.add_topic(BagTopic.of_type(name, STRING))
    writer.close()
    with pytest.raises(BagError, match=r'but /left/chatter, /right/chatter; give the sensor .* replay_hand\)'):
        play(bag=str(tmp_path / 'hand'), topics=['chatter'])


def test_tells_the_time_of_the_bag_on_clock(bus, play) -> None:
    clock = listen(bus, '/clock', 'rosgraph_msgs/msg/Clock')
    play(clock_hz=10.0).spin()
    times_ns = []
    while (received := clock.take()) is not None:
        times_ns.append(stamp_ns(received.message.clock) - START_NS)
    assert times_ns == [number * 100_000_000 for number in range(COUNT)]


def test_paused_player_plays_one_message_a_call(bus, play) -> None:
    chatter = listen(bus, '/chatter')
    node = play(paused=True, topics=['chatter'])
    for number in range(2):
        node.play_next()
        received = chatter.get(timeout_s=10.0)
        assert received is not None
        assert received.message.data == str(number)
    assert chatter.take() is None


def test_paused_player_that_resumes_plays_the_rest(bus, play) -> None:
    chatter = listen(bus, '/chatter')
    node = play(paused=True)
    assert heard(chatter) == []
    assert node.toggle_paused() == 'playing'
    node.spin()
    assert heard(chatter) == NUMBERS


def test_next_is_refused_while_playing(play) -> None:
    node = play(loop=True)
    with pytest.raises(BagError, match='pause first'):
        node.play_next()


def test_looping_player_ends_when_it_is_closed(bus, play) -> None:
    seen = threading.Event()
    counted = []

    def count() -> None:
        counted.append(1)
        if len(counted) > 2 * COUNT:
            seen.set()

    bus.subscribe('/chatter', STRING, Qos('queue', 10), on_ready=count)
    node = play(loop=True)
    assert seen.wait(10.0)
    node.close()
    node._thread.join(30.0)
    assert not node._thread.is_alive()


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'bag': '/none'}, 'there is no bag'),
        ({'bag': ''}, 'set the parameter bag'),
        ({'start_offset': 1000.0}, r'lasts \d+\.\d s; there is nothing to play after 1000 s'),
        ({'topics': ['wrench']}, r'holds no /wrench; see: tactile bag info'),
    ],
)
def test_what_cannot_be_played_is_refused(play, values: dict[str, object], reason: str) -> None:
    with pytest.raises(BagError, match=reason):
        play(**values)


def test_further_topics_are_played_if_the_bag_holds_them(bus, play) -> None:
    chatter, rest = listen(bus, '/chatter'), listen(bus, '/rest')
    play(topics=['/chatter'], topics_if_there=['/rest', '/not_there']).spin()
    assert heard(chatter) == NUMBERS
    assert heard(rest) == ['rest']
