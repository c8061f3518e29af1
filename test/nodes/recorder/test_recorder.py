"""The recorder node: what it subscribes to, when, and what it says."""

from __future__ import annotations

import errno
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from feeding import START_NS, located, run

from tactile_nodes import messages
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import BagError, ConfigurationError
from tactile_nodes.messages import services, types
from tactile_nodes.nodes.recorder import RecorderNode

Start = Callable[..., RecorderNode]


@pytest.fixture
def start(bus: InProcessBus, clock: SteppedClock, tmp_path: Path) -> Iterator[Start]:
    made: list[RecorderNode] = []

    def make(**values: object) -> RecorderNode:
        made.append(RecorderNode(bus, located(**{'bag': str(tmp_path / 'bag'), **values}), clock))
        return made[-1]

    yield make
    for node in made:
        if node.writer is not None:
            node.close()


def advertise(bus: InProcessBus, name: str, type_name: str = 'std_msgs/msg/String', latched: bool = False):
    return bus.advertise(name, type_name, Qos('latest', 1, latched), '/talker')


def content(folder: Path) -> list[tuple[str, str]]:
    with BagReader(folder) as reader:
        assert reader.problems == []
        return [(message.topic, reader.decode(message).data) for message in reader.messages()]


@pytest.mark.parametrize('begins_with', ['pictures', '*/pictures'])
def test_without_the_topic_that_a_recording_begins_with_no_bag_is_left(
    bus, start: Start, tmp_path: Path, begins_with: str
) -> None:
    talker, camera = advertise(bus, '/chatter'), advertise(bus, '/left/pictures')
    camera.sequence = 1000  # runs already, so that the replay which is to be recorded is refused
    node = start(all=True, begins_with=begins_with)
    talker.publish(types.String(data='before'))
    camera.publish(types.String(data='of another sensor'))
    run(node)
    assert 'recorded nothing, because no message came on' in node.stop_recording()
    assert list(tmp_path.iterdir()) == []


def test_what_came_before_the_topic_that_a_recording_begins_with_is_recorded_too(
    bus, clock: SteppedClock, start: Start, tmp_path: Path
) -> None:
    talker, pictures = advertise(bus, '/chatter'), advertise(bus, '/left/pictures')
    node = start(topics=['chatter', 'left/pictures'], begins_with='*/pictures')
    talker.publish(types.String(data='before'))
    run(node)
    clock.advance(5.0)  # far beyond the time in which any other recording begins
    pictures.publish(types.String(data='picture'))
    run(node)
    node.close()
    assert content(tmp_path / 'bag') == [('/chatter', 'before'), ('/left/pictures', 'picture')]


def test_messages_that_wait_for_the_first_picture_do_not_fill_the_memory(bus, start: Start, tmp_path: Path) -> None:
    talker, _ = advertise(bus, '/chatter'), advertise(bus, '/pictures')
    node = start(topics=['chatter', 'pictures'], begins_with='/pictures', queue_mb=2)
    sent = [f'{number} ' + 'x' * 300_000 for number in range(5)]
    for each in sent:
        talker.publish(types.String(data=each))
    run(node)
    assert 'wrote 5 messages' in node.stop_recording()
    assert content(tmp_path / 'bag') == [('/chatter', each) for each in sent]


def test_records_every_message_of_the_topics_it_is_given(bus, start: Start, tmp_path: Path) -> None:
    talker, other = advertise(bus, '/chatter'), advertise(bus, '/other')
    node = start(topics=['chatter'])
    for number in range(500):  # more than any latest-only subscription would keep
        talker.publish(types.String(data=str(number)))
        other.publish(types.String(data='not this'))
    run(node)
    node.close()
    assert content(tmp_path / 'bag') == [('/chatter', str(number)) for number in range(500)]


def test_publisher_that_appears_later_is_recorded(bus, clock, start: Start, tmp_path: Path) -> None:
    node = start(all=True, exclude='rosout|diagnostics')
    talker = advertise(bus, '/late')
    clock.advance(0.2)
    node.spin_once()
    talker.publish(types.String(data='hello'))
    run(node)
    node.close()
    assert content(tmp_path / 'bag') == [('/late', 'hello')]


def test_default_is_what_the_topic_table_marks_in_any_namespace(bus, start: Start) -> None:
    advertise(bus, '/left/wrench', topics.WRENCH.type_name)
    advertise(bus, '/clock', topics.CLOCK.type_name)
    advertise(bus, '/chatter')
    node = start()
    recorded = {end.name for end in bus.graph().subscriptions() if end.node == node.full_name}
    assert recorded == {'/left/wrench', '/rosout', '/diagnostics'}


def test_bytes_and_times_are_those_of_the_travelling_message(bus, clock, start: Start, tmp_path: Path) -> None:
    wrench = advertise(bus, '/wrench', topics.WRENCH.type_name)
    node = start(topics=['wrench'])
    message = types.WrenchStamped(header=types.Header(stamp=messages.time_from_ns(START_NS - 5_000_000)))
    clock.advance(0.25)
    wrench.publish(message)
    run(node)
    node.close()
    with BagReader(tmp_path / 'bag') as reader:
        (found,) = reader.messages()
    assert found.data == messages.encode(message)
    assert (found.log_ns, found.publish_ns) == (START_NS + 250_000_000, START_NS - 5_000_000)


def test_latched_message_from_before_is_received_when_recording_begins(bus, clock, start, tmp_path: Path) -> None:
    advertise(bus, '/rest', latched=True).publish(types.String(data='rest image'))
    clock.advance(60.0)
    node = start(topics=['rest'])
    run(node)
    node.close()
    with BagReader(tmp_path / 'bag') as reader:
        (found,) = reader.messages()
        assert reader.topics['/rest'].latched
    assert found.log_ns == START_NS + 60_000_000_000


def picture(number: int) -> types.Image:
    return types.Image(height=number)


def test_recording_begins_when_every_topic_of_a_running_sensor_was_received(bus, clock, start, tmp_path: Path) -> None:
    image = advertise(bus, '/image_raw', topics.IMAGE.type_name)
    info = advertise(bus, '/camera_info', topics.CAMERA_INFO.type_name)
    rest = advertise(bus, '/reference_image', topics.REFERENCE_IMAGE.type_name, latched=True)
    rest.publish(picture(99))
    image.sequence = info.sequence = 1000  # they have been publishing for a while
    node = start()
    for number in range(10):
        image.publish(picture(number))
        if number >= 6:  # as if its connection had taken that long
            info.publish(types.CameraInfo(height=number))
        run(node)
        clock.advance(0.02)
        assert node.recorded_s == pytest.approx(0.02 * max(0, number - 5))  # what `--duration` counts
    summary = node.stop_recording()
    with BagReader(tmp_path / 'bag') as reader:
        found = [
            (message.topic, reader.decode(message).height)
            for message in reader.messages(['/image_raw', '/camera_info', '/reference_image'])
        ]
    pairs = [pair for number in range(7, 10) for pair in (('/image_raw', number), ('/camera_info', number))]
    assert found == [('/reference_image', 99), ('/image_raw', 6), ('/camera_info', 6), *pairs]
    assert f' into {tmp_path / "bag"}' in summary
    assert 'late' not in summary


def test_with_simulated_time_a_recording_begins_by_the_clock_of_its_stamps(bus, clock, tmp_path: Path) -> None:
    talker = advertise(bus, '/chatter')
    talker.sequence = 1000
    node = RecorderNode(bus, located(bag=str(tmp_path / 'bag'), all=True, use_sim_time=True))
    for _ in range(5):
        talker.publish(types.String(data='hello'))
        run(node)
        clock.advance(0.02)
    assert 'heard late' not in node.stop_recording()  # not 1000 messages since 1970, where /clock has not come yet
    node.close()


def test_a_topic_that_is_heard_late_is_reported_at_the_end(bus, clock, start: Start, tmp_path: Path) -> None:
    image = advertise(bus, '/image_raw', topics.IMAGE.type_name)
    info = advertise(bus, '/camera_info', topics.CAMERA_INFO.type_name)
    image.sequence = info.sequence = 1000
    node = start()
    for number in range(250):  # 5 s
        image.publish(picture(number))
        info.sequence += number < 150
        if number >= 150:
            info.publish(types.CameraInfo(height=number))
        run(node)
        clock.advance(0.02)
        node.spin_once(0.0)
    summary = node.stop_recording()
    # The pictures of 3 s, one every 20 ms, stand without their 150 camera_info.
    assert '; heard late: /camera_info 3.0 s (about 150 messages)' in summary
    status = {entry.name: entry for entry in diagnosed(node)}['recorder: bag']
    values = {entry.key: entry.value for entry in status.values}
    assert (status.level, status.message) == (Level.WARN, summary)
    assert (values['bag'], values['lost'], values['lost_of']) == (str(tmp_path / 'bag'), '150', '/camera_info 150')


@pytest.mark.parametrize('topic', [topics.ROSOUT, topics.DIAGNOSTICS, topics.CONTACT], ids=lambda each: each.name)
def test_a_topic_that_comes_now_and_then_is_not_reported_as_heard_late(
    topic: topics.Topic, bus, clock, start: Start
) -> None:
    """Two messages within a millisecond, after ten seconds without any; a hand reports its sensors so, each second."""
    talker = advertise(bus, f'/{topic.name.lstrip("/")}', topic.type_name)
    talker.sequence = 100
    node = start()
    for after_s in (10.0, 0.001):
        clock.advance(after_s)
        talker.publish(messages.message_class(topic.type_name)())
        run(node)
    assert 'heard late' not in node.stop_recording()


def diagnosed(node: RecorderNode) -> list[types.DiagnosticStatus]:
    node._report_health()
    return node.diagnostics.message(0).status


def test_services_start_and_stop_a_recording(bus, start: Start, tmp_path: Path) -> None:
    talker = advertise(bus, '/chatter')
    with spinning(start(autostart=False, topics=['chatter'])) as node:
        talker.publish(types.String(data='before'))
        assert call(bus, node, 'start').message == f'recording into {tmp_path / "bag"}'
        talker.publish(types.String(data='meanwhile'))
        answer = call(bus, node, 'stop')
        talker.publish(types.String(data='after'))
    assert answer.success
    assert answer.message.startswith('wrote 1 messages (0.0 MB, 0.0 s) into ')
    assert content(tmp_path / 'bag') == [('/chatter', 'meanwhile')]


def test_starting_twice_is_refused_with_what_to_do(bus, start: Start) -> None:
    with spinning(start()) as node:
        answer = call(bus, node, 'start')
    assert not answer.success
    assert 'stop it first' in answer.message


def test_stopping_nothing_is_refused(bus, start: Start) -> None:
    with spinning(start(autostart=False)) as node:
        answer = call(bus, node, 'stop')
    assert (answer.success, answer.message) == (False, 'nothing is being recorded')


def test_a_bag_that_could_not_be_ended_stays_reported(bus, start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk is full when the index is written: whoever looks later must not read that all is well."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    with spinning(start()) as node:
        assert node.writer is not None
        monkeypatch.setattr(node.writer._file, 'close', full)
        answer = call(bus, node, 'stop')
        (status,) = diagnosed(node)
    assert not answer.success
    assert (status.level, status.message) == (Level.ERROR, answer.message)
    assert 'No space left on device' in status.message
    assert node.failure is not None  # its program ends with status 1


def call(bus: InProcessBus, node: RecorderNode, name: str) -> types.Trigger_Response:
    return bus.call(f'{node.full_name}/{name}', services.TRIGGER, types.Trigger_Request())


@contextmanager
def spinning(node: RecorderNode) -> Iterator[RecorderNode]:
    thread = threading.Thread(target=node.spin)
    thread.start()
    try:
        yield node
    finally:
        node.stop()
        thread.join()


def test_messages_that_were_lost_on_the_way_are_counted_and_reported(bus, clock, start: Start) -> None:
    talker = advertise(bus, '/chatter')
    node = start(topics=['chatter'])
    for skipped in (0, 3):
        talker.sequence += skipped
        talker.publish(types.String(data='hello'))
    run(node)
    clock.advance(0.6)
    node.spin_once()
    status = {entry.name: entry for entry in node.diagnostics.message(0).status}['recorder: bag']
    assert node.tally.missed == 3
    assert (status.level, status.message) == (Level.WARN, 'lost on the way to the recorder: 3 of /chatter')
    assert {entry.key: entry.value for entry in status.values}['missed'] == '3'


def test_a_topic_that_was_named_and_that_nobody_publishes_is_reported(bus, clock, start: Start) -> None:
    talker = advertise(bus, '/chatter')
    node = start(topics=['chatter', 'chater'])
    talker.publish(types.String(data='hello'))
    run(node)
    statuses = []
    for _ in range(6):
        clock.advance(1.0)
        node.spin_once()
        statuses += [(each.level, each.message) for each in node.diagnostics.message(0).status if 'bag' in each.name]
    assert [level for level, _ in statuses] == [Level.OK] * 4 + [Level.WARN] * 2
    assert statuses[-1][1] == 'no publisher of /chater'
    assert node.stop_recording().endswith('; no messages on /chater')


def test_folder_that_exists_ends_the_node_before_it_begins(start: Start, tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='already exists'):
        start()


def test_expression_that_is_none_is_refused(start: Start) -> None:
    with pytest.raises(ConfigurationError, match='not a regular expression'):
        start(regex='[')


def test_messages_of_another_version_are_counted_and_reported(tmp_path: Path) -> None:
    arguments = located(bag=str(tmp_path / 'bag'), topics=['chatter'])
    expected = (
        Level.WARN,
        'foreign messages are left out: of another type, or version of it, or of an unknown publisher',
    )
    with (
        TemporaryDirectory() as folder,
        closing(ZmqBus(7, folder=Path(folder))) as bus,
        closing(ZmqBus(7, folder=Path(folder))) as other,
        closing(RecorderNode(bus, arguments)) as made,
        spinning(made) as node,
    ):
        talker = other.advertise('/chatter', 'std_msgs/msg/String', Qos('queue', 100))
        talker._key = wire.type_key('std_msgs/msg/Int64')  # as the hash of another release would be another
        until(lambda: talker.listeners)
        for number in range(5):
            talker.publish(types.String(data=str(number)))
        until(lambda: expected in [(entry.level, entry.message) for entry in node.diagnostics.message(0).status])
        answer = call(bus, node, 'stop')
    assert '; malformed: 5 of /chatter; /chatter: the rest can be used' in answer.message


def until(condition: Callable[[], object]) -> None:
    waiting = threading.Event()
    for _ in range(1000):
        if condition():
            return
        waiting.wait(0.01)
    raise AssertionError('it never came to be')


ON_A_SLOW_DISK = """
import os, signal, sys, threading, time
from tactile_nodes.bag import growing_file
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.node.runtime import open_bus
from tactile_nodes.messages import types
from tactile_nodes.nodes.recorder import RecorderNode, main

pwrite, disk_is_free = os.pwrite, threading.Event()
take_in, taken = RecorderNode._take_in, []

def slow_pwrite(descriptor, data, offset):
    assert offset == 0 or disk_is_free.wait(20)  # the head of the file is written at once
    return pwrite(descriptor, data, offset)

def count_and_take_in(node, name, received, writer):
    take_in(node, name, received, writer)
    taken.append(received)

def talk():
    publisher = open_bus().advertise('/chatter', 'std_msgs/msg/String', Qos('queue', 1000))
    while not publisher.listeners:
        time.sleep(0.01)
    for number in range(500):
        publisher.publish(types.String(data=str(number)))
    while len(taken) < 500:
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(2.5)
    disk_is_free.set()

growing_file.os.pwrite, RecorderNode._take_in = slow_pwrite, count_and_take_in
threading.Thread(target=talk, daemon=True).start()
sys.argv = ['recorder_node', '--ros-args', '-p', 'topics:=[chatter]', '-p', f'bag:={sys.argv[1]}']
sys.exit(main())
"""


def test_what_waits_for_a_slow_disk_at_the_end_is_written_and_spoken_of(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, '-c', ON_A_SLOW_DISK, str(tmp_path / 'bag')], capture_output=True, text=True, check=False
    )
    assert 'messages that still wait for the disk: 500' in ended.stderr
    assert ended.returncode == 0
    assert content(tmp_path / 'bag') == [('/chatter', str(number)) for number in range(500)]
