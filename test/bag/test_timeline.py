"""Playing: when each message is due, and that nothing adds up on the way."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from bagging import FORCE, START_NS, STEP_NS, STRING, Sample, force, samples, text, write
from hypothesis import given
from hypothesis import strategies as st
from jumping_clock import JumpingClock

from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.playback import Playback, Timeline
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import encode, types

NOW_NS = 5_000_000_000


def started(rate: float = 1.0) -> Timeline:
    line = Timeline(rate=rate)
    line.start(NOW_NS, START_NS)
    return line


def test_twice_the_rate_halves_the_distances() -> None:
    assert started(rate=2.0).due_ns(START_NS + 100) == NOW_NS + 50


def test_pause_moves_everything_that_follows_by_its_length() -> None:
    line = started()
    line.pause(NOW_NS + 30)
    assert line.due_ns(START_NS + 100) is None
    assert line.bag_ns(NOW_NS + 500) == START_NS + 30
    line.resume(NOW_NS + 1030)
    assert line.due_ns(START_NS + 100) == NOW_NS + 1100


def test_pausing_twice_is_pausing_once() -> None:
    line = started()
    line.pause(NOW_NS + 30)
    line.pause(NOW_NS + 90)
    assert line.bag_ns(NOW_NS + 100) == START_NS + 30


@given(st.lists(st.tuples(st.integers(1, 10**9), st.floats(0.1, 10.0)), max_size=20))
def test_changing_the_rate_never_makes_the_bag_jump(changes) -> None:
    line, now_ns = started(), NOW_NS
    for passed_ns, rate in changes:
        now_ns += passed_ns
        before_ns = line.bag_ns(now_ns)
        line.set_rate(now_ns, rate)
        assert line.bag_ns(now_ns) == before_ns


@pytest.fixture
def clock() -> JumpingClock:
    return JumpingClock(NOW_NS)


def played(folder: Path, clock: JumpingClock, offset_s: float = 0.0, **options) -> list[tuple[int, str, bytes]]:
    """What was played, with the time since the start at which it was."""
    found: list[tuple[int, str, bytes]] = []
    with BagReader(folder) as reader:
        Playback(
            reader,
            list(reader.topics),
            lambda message: found.append((clock.now_ns() - NOW_NS, message.topic, message.data)),
            clock,
            **options,
        ).run(offset_s)
    return found


def test_messages_leave_at_the_distances_in_which_they_came(bag: Path, clock: JumpingClock) -> None:
    assert [at_ns for at_ns, _, _ in played(bag, clock)] == [number * STEP_NS for number in range(10)]


def test_the_same_bytes_leave(bag: Path, clock: JumpingClock) -> None:
    assert [(topic, data) for _, topic, data in played(bag, clock)] == [(s.topic, s.data) for s in samples(10)]


def test_rate_scales_the_distances(bag: Path, clock: JumpingClock) -> None:
    assert [at_ns for at_ns, _, _ in played(bag, clock, rate=0.5)] == [number * 2 * STEP_NS for number in range(10)]


def test_time_lost_in_one_message_is_not_added_to_the_next(bag: Path, clock: JumpingClock) -> None:
    left = []

    def publish_slowly(_) -> None:
        left.append(clock.now_ns() - NOW_NS)
        clock.advance(0.004)  # of the 10 ms between messages

    with BagReader(bag) as reader:
        Playback(reader, list(reader.topics), publish_slowly, clock).run()
    assert left == [number * STEP_NS for number in range(10)]


def test_after_a_stop_of_the_process_the_rest_does_not_leave_at_once(bag: Path, clock: JumpingClock) -> None:
    left = []

    def publish(_) -> None:
        left.append(clock.now_ns() - NOW_NS)
        if len(left) == 3:
            clock.advance(5.0)  # Ctrl-Z

    with BagReader(bag) as reader:
        Playback(reader, list(reader.topics), publish, clock).run()
    stopped_ns = 2 * STEP_NS + 5_000_000_000
    assert left[3:] == [stopped_ns + number * STEP_NS for number in range(7)]


def test_start_offset_skips_but_gives_the_last_latched_message(bag: Path, clock: JumpingClock) -> None:
    content = samples(10)
    found = played(bag, clock, offset_s=0.06)
    assert found[0] == (0, '/text', content[5].data)
    assert [data for _, _, data in found[1:]] == [sample.data for sample in content[6:]]
    assert [at_ns for at_ns, _, _ in found[1:]] == [number * STEP_NS for number in range(4)]


def written_with_latched(folder: Path, topic: str, type_name: str = STRING) -> BagWriter:
    """A bag of forces and a latched topic, to be written."""
    writer = BagWriter(folder)
    writer.add_topic(BagTopic.of_type('/force', FORCE))
    writer.add_topic(BagTopic.of_type(topic, type_name, latched=True))
    return writer


def test_start_offset_gives_the_latched_transforms_of_all_publishers(tmp_path: Path, clock: JumpingClock) -> None:
    kind = 'tf2_msgs/msg/TFMessage'
    arm, camera = (
        encode(types.TFMessage(transforms=[types.TransformStamped(child_frame_id=frame)]))
        for frame in ('arm', 'camera')
    )
    writer = written_with_latched(tmp_path / 'bag', '/tf_static', kind)
    for number, (topic, data) in enumerate([('/tf_static', arm), ('/tf_static', camera), ('/force', force(0, 0))]):
        writer.write(topic, data, START_NS + number * STEP_NS, START_NS)
    writer.close()
    assert [data for _, _, data in played(tmp_path / 'bag', clock, offset_s=0.02)] == [arm, camera, force(0, 0)]


def looped(bag: Path, clock: JumpingClock, topic: str, offset_s: float = 0.0) -> list[bytes]:
    """What is played in a loop until it ends, but no more than twelve messages."""
    found: list[bytes] = []
    with BagReader(bag) as reader:

        def publish(message) -> None:
            found.append(message.data)
            if len(found) == 12:
                playback.stop()

        playback = Playback(reader, [topic], publish, clock)
        playback.run(offset_s, loop=True)
    return found


def test_loop_begins_again_at_the_end(bag: Path, clock: JumpingClock) -> None:
    found = looped(bag, clock, '/force')
    once = [sample.data for sample in samples(10) if sample.topic == '/force']
    assert found == (once * 3)[:12]


def test_clock_ticks_tell_the_time_of_the_bag(tmp_path: Path, clock: JumpingClock) -> None:
    first, last = samples(1)[0], samples(1)[0]
    write(tmp_path / 'pause', [first, Sample(last.topic, START_NS + 1_000_000_000, last.data)])
    ticks: list[int] = []
    played(tmp_path / 'pause', clock, rate=2.0, tick=ticks.append, tick_hz=10.0)
    # Half a second of playing at 10 Hz; between two ticks the bag moves on by 0.2 s.
    assert [tick - START_NS for tick in ticks] == [number * 200_000_000 for number in range(6)]


def test_paused_playback_plays_one_message_a_step(bag: Path) -> None:
    clock = SteppedClock(NOW_NS)
    arrived = threading.Semaphore(0)
    found: list[bytes] = []

    def publish(message) -> None:
        found.append(message.data)
        arrived.release()

    with BagReader(bag) as reader:
        playback = Playback(reader, list(reader.topics), publish, clock)
        playback.pause()
        thread = threading.Thread(target=playback.run)
        thread.start()
        for number in range(3):
            playback.step()
            while not arrived.acquire(timeout=0.001):
                clock.advance(0.02)
            assert len(found) == number + 1
        playback.stop()
        while thread.is_alive():
            clock.advance(0.02)
            thread.join(0.001)
    assert found == [sample.data for sample in samples(3)]


def latched_bag(folder: Path, received_ns: int, published_ns: int) -> Path:
    """Ten pictures 10 ms apart, each captured 3 ms before, and a latched text, received and published then."""
    writer = written_with_latched(folder, '/rest')
    for number in range(10):
        at_ns = START_NS + number * STEP_NS
        writer.write('/force', force(number, at_ns - 3_000_000), at_ns, at_ns)
    writer.write('/rest', text(0), START_NS + received_ns, START_NS + published_ns)
    writer.close()
    return folder


def test_what_a_latched_topic_said_before_the_recording_is_played_before_the_first_picture(tmp_path, clock) -> None:
    found = played(latched_bag(tmp_path / 'bag', received_ns=55_000_000, published_ns=-60_000_000_000), clock)
    assert [topic for _, topic, _ in found] == ['/rest'] + ['/force'] * 10
    assert [at_ns for at_ns, _, _ in found] == [0] + [number * STEP_NS for number in range(10)]


def test_what_a_latched_topic_said_meanwhile_is_played_when_it_was_reported(tmp_path, clock) -> None:
    found = played(latched_bag(tmp_path / 'bag', received_ns=55_000_000, published_ns=54_000_000), clock)
    assert [topic for _, topic, _ in found] == ['/force'] * 6 + ['/rest'] + ['/force'] * 4


def test_what_several_publishers_of_a_latched_topic_said_is_all_played_first(tmp_path: Path, clock) -> None:
    writer = written_with_latched(tmp_path / 'bag', '/tf_static')
    writer.write('/force', force(0, START_NS), START_NS, START_NS)
    for number in (1, 2):
        writer.write('/tf_static', text(number), START_NS + number, START_NS - 1000)
    writer.close()
    assert [data for _, _, data in played(tmp_path / 'bag', clock)] == [text(1), text(2), force(0, START_NS)]


def test_a_loop_that_has_only_latched_messages_left_ends(bag: Path, clock: JumpingClock) -> None:
    """They would be published again and again without a pause."""
    found = looped(bag, clock, '/text', 0.095)
    assert found == [[sample.data for sample in samples(10) if sample.topic == '/text'][-1]]
