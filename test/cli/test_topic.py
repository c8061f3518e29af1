"""``tactile topic`` against a real bus."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from jumping_clock import JumpingClock
from running_system import Tactile, wait_until

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Endpoint, Qos, Received
from tactile_nodes.bus.topics import TF_STATIC
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.cli.main import main
from tactile_nodes.cli.running.session import interruptible
from tactile_nodes.cli.topic import _end_text
from tactile_nodes.cli.topic.echo import awaited_type
from tactile_nodes.cli.topic.pub import _publish_all
from tactile_nodes.cli.topic.rate import Bandwidth, Delay, Rate
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.viewing.gaps import SequenceGaps

STRING = 'std_msgs/msg/String'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
QUEUE = Qos('queue', 100)
Repeating = Callable[[Callable[[], None]], None]
MS = 1_000_000


def test_topics_are_listed_with_their_types_and_hidden_ones_when_asked_for(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    other.subscribe('/a', WRENCH, QUEUE)
    other.advertise('/_secret/a', STRING, QUEUE)
    assert tactile('topic', 'list').out == '/a\n/b\n'
    assert tactile('topic', 'list', '-t').out == f'/a [{WRENCH}]\n/b [{STRING}]\n'
    assert tactile('topic', 'list', '-c').out == '2\n'
    assert tactile('topic', 'list', '-a').out == '/_secret/a\n/a\n/b\n'


def test_a_verbose_list_counts_both_ends(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    other.advertise('/b', STRING, QUEUE)
    other.subscribe('/b', STRING, QUEUE)
    printed = tactile('topic', 'list', '-v').out
    assert printed == (
        f'Published topics:\n * /b [{STRING}] 2 publishers\n\nSubscribed topics:\n * /b [{STRING}] 1 subscriber\n\n'
    )


def test_what_was_not_published_during_a_pause_is_not_published_at_once_after_it() -> None:
    """Ctrl-Z and fg, say: a gripper must not get a hundred commands in a moment."""
    times_ms: list[int] = []

    class Paused(SteppedClock):
        def sleep_until(self, deadline_ns: int) -> None:
            self.set_ns(max(self.now_ns(), deadline_ns))

    class Publishing:
        type_name = STRING

        def publish(self, _: object) -> None:
            times_ms.append(clock.now_ns() // MS)
            clock.advance(1.0 if len(times_ms) == 2 else 0.001)

    clock = Paused()
    arguments = argparse.Namespace(once=False, times=5, rate=10.0, print=0, keep_alive=0.0)
    _publish_all(SimpleNamespace(clock=clock), Publishing(), {'data': 'hi'}, arguments)
    assert times_ms == [0, 100, 1100, 1200, 1300]


def test_info_tells_type_and_counts_and_with_verbose_names_the_ends(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/skin/b', STRING, QUEUE, '/skin/talker')
    counts = 'Publisher count: 1\nSubscription count: 0\n'
    assert tactile('topic', 'info', 'skin/b').out == f'Type: {STRING}\n\n{counts}'
    lines = tactile('topic', 'info', '/skin/b', '-v').out.splitlines()
    assert {'Node name: talker', 'Node namespace: /skin', 'Endpoint type: PUBLISHER'} <= set(lines)


def test_find_and_type_are_each_others_reverse(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    assert tactile('topic', 'type', '/b').out == f'{STRING}\n'
    assert tactile('topic', 'find', 'std_msgs/String').out == '/b\n'


def test_verbose_info_also_names_the_ends_of_types_that_are_not_known_here() -> None:
    end = Endpoint('/arm/state', 'arm_msgs/msg/State', '/arm/driver')  # as of any other package of a ROS 2 graph
    assert _end_text(end, 'PUBLISHER').splitlines()[:4] == [
        'Node name: driver', 'Node namespace: /arm', 'Topic type: arm_msgs/msg/State',
        'Topic type hash: not known here',
    ]  # fmt: skip


@pytest.mark.parametrize('command', ['info', 'type'])
def test_an_unknown_topic_is_reported_in_one_line(command: str, tactile: Tactile) -> None:
    ended = tactile('topic', command, '/nothing')
    assert (ended.status, ended.out) == (1, '')
    assert ended.err.startswith('there is no topic /nothing')
    assert ended.err.count('\n') == 1


@pytest.fixture
def clock_of_nobody(monkeypatch: pytest.MonkeyPatch) -> SteppedClock:
    """That of a bus without topics, which the commands join; it passes only by being slept through."""
    clock = JumpingClock()
    monkeypatch.setattr('tactile_nodes.bus.node.runtime.open_bus', lambda: InProcessBus(clock))
    return clock


@pytest.mark.parametrize(
    ('words', 'waits_s'),
    [*(((command, '/nothing'), '10') for command in ('echo', 'hz', 'bw', 'delay')),
     (('echo', '/nothing', '--timeout', '0.1'), '0.1')],
)  # fmt: skip
def test_what_listens_waits_for_an_unknown_topic_and_gives_up(
    words: tuple[str, ...], waits_s: str, tactile: Tactile, clock_of_nobody: SteppedClock
) -> None:
    ended = tactile('topic', *words)
    assert (ended.status, ended.out) == (1, '')
    waiting, given_up = ended.err.splitlines()
    assert waiting == f'no publisher and no subscriber of /nothing yet; waiting up to {waits_s} s'
    assert given_up.startswith('there is no topic /nothing')
    assert clock_of_nobody.now_ns() == round(float(waits_s) * 1000) * MS


def test_a_topic_that_appears_after_four_seconds_is_waited_for(capsys: pytest.CaptureFixture[str]) -> None:
    class Advertising(SteppedClock):
        def sleep_until(self, deadline_ns: int) -> None:
            self.set_ns(deadline_ns)
            if deadline_ns == 4000 * MS:
                bus.advertise('/late', STRING, QUEUE)

    bus = InProcessBus(Advertising())
    assert awaited_type(bus, '/late') == STRING
    assert bus.clock.now_ns() == 4000 * MS
    assert capsys.readouterr().err.count('waiting up to 10 s') == 1


def test_a_topic_of_two_types_needs_the_type(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    other.advertise('/b', WRENCH, QUEUE)
    ended = tactile('topic', 'echo', '/b')
    assert ended.status == 1
    assert f'{WRENCH}, {STRING}' in ended.err


def test_echo_once_prints_one_message_and_ends(other: ZmqBus, tactile: Tactile, repeating: Repeating) -> None:
    publisher = other.advertise('/b', STRING, QUEUE)
    repeating(lambda: publisher.publish(types.String(data='hello')))
    ended = tactile('topic', 'echo', '/b', '--once')
    assert (ended.status, ended.out) == (0, 'data: hello\n---\n')


def test_echo_prints_one_field(other: ZmqBus, tactile: Tactile, repeating: Repeating) -> None:
    publisher = other.advertise('/b', WRENCH, QUEUE)
    message = types.WrenchStamped(wrench=types.Wrench(force=types.Vector3(z=0.25)))
    repeating(lambda: publisher.publish(message))
    assert tactile('topic', 'echo', 'b', '--once', '--field', 'wrench.force.z').out == '0.25\n---\n'
    assert tactile('topic', 'echo', 'b', '--once', '--field', 'wrench.force', '--csv').out == '0.0,0.0,0.25\n'


def test_echo_of_a_latched_topic_prints_what_was_reported_before(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/reference_image', STRING, Qos('latest', 1, latched=True)).publish(types.String(data='rest'))
    assert tactile('topic', 'echo', '/reference_image', '--once').out == 'data: rest\n---\n'


@pytest.mark.parametrize(
    'words',
    [
        ('topic', 'pub', '--once', '/a b', STRING, '{data: x}'),
        ('topic', 'pub', '--once', '-n', 'my-node', '/a', STRING, '{data: x}'),
        ('topic', 'echo', 'a//b', STRING),
        ('service', 'call', '/1', 'std_srvs/srv/Trigger', '{}'),
        ('param', 'list', 'camera/'),
    ],
)
def test_a_name_that_ros_2_refuses_is_refused_here(tactile: Tactile, words: tuple[str, ...]) -> None:
    ended = tactile(*words)
    assert (ended.status, ended.out) == (1, '')
    assert 'is not a valid name of a' in ended.err


def test_echo_ends_with_an_error_when_nothing_comes(other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    ended = tactile('topic', 'echo', '/b', '--timeout', '0.2')
    assert (ended.status, ended.err) == (1, 'no message on /b within 0.2 s\n')


def test_echo_of_a_wrong_field_names_those_there_are(other: ZmqBus, tactile: Tactile, repeating: Repeating) -> None:
    publisher = other.advertise('/b', STRING, QUEUE)
    repeating(lambda: publisher.publish(types.String(data='hello')))
    ended = tactile('topic', 'echo', '/b', '--field', 'date')
    assert (ended.status, ended.err) == (1, f"{STRING} has no 'date': its fields are data\n")


def test_gaps_are_counted_for_each_publisher_by_itself() -> None:
    gaps = SequenceGaps()
    found = [gaps.add(*seen) for seen in (('a', 7), ('b', 1), ('a', 8), ('a', 11), ('b', 2), ('a', 12))]
    assert found == [0, 0, 0, 2, 0, 0]
    assert gaps.total == 2


def test_pub_once_waits_for_a_subscriber_and_reaches_it(other: ZmqBus, tactile: Tactile) -> None:
    subscription = other.subscribe('/b', STRING, QUEUE)
    ended = tactile('topic', 'pub', '--once', '/b', 'std_msgs/String', '{data: hello}')
    assert ended.status == 0
    lines = [line for line in ended.out.splitlines() if not line.startswith('Waiting for ')]  # as on a busy machine
    assert lines == ['publisher: beginning loop', "publishing #1: std_msgs.msg.String(data='hello')", '']
    received = subscription.get(30.0)
    assert received is not None
    assert received.message.data == 'hello'


def test_pub_reaches_a_subscriber_that_comes_later(other: ZmqBus, tactile: Tactile) -> None:
    received: list[Received | None] = []

    def listen() -> None:
        wait_until(lambda: '/b' in other.graph().topics())
        received.append(other.subscribe('/b', STRING, QUEUE).get(30.0))

    thread = threading.Thread(target=listen)
    thread.start()
    assert tactile('topic', 'pub', '-1', '/b', STRING, '{data: late}').status == 0
    thread.join()
    assert received[0] is not None
    assert received[0].message.data == 'late'


def test_pub_gives_up_waiting_when_told_so(tactile: Tactile) -> None:
    ended = tactile('topic', 'pub', '-1', '--max-wait-time-secs', '0.1', '/b', STRING)
    assert ended.status == 1
    assert ended.err.startswith('nothing was published: 0 of 1 subscribers appeared within 0.1 s')


def test_pub_times_publishes_that_often(other: ZmqBus, tactile: Tactile) -> None:
    subscription = other.subscribe('/b', STRING, QUEUE)
    tactile('topic', 'pub', '-t', '3', '-r', '200', '--print', '0', '/b', STRING, '{data: x}')
    assert [subscription.get(30.0) is not None for _ in range(3)] == [True] * 3
    assert subscription.take() is None


def test_pub_fills_in_the_stamp(other: ZmqBus, tactile: Tactile) -> None:
    subscription = other.subscribe('/w', WRENCH, QUEUE)
    before_ns = other.clock.now_ns()
    tactile('topic', 'pub', '-1', '/w', WRENCH, '{header: auto, wrench: {force: {z: 1}}}')
    received = subscription.get(30.0)
    assert received is not None
    stamp = received.message.header.stamp
    assert before_ns <= stamp.sec * 1_000_000_000 + stamp.nanosec <= other.clock.now_ns()
    assert received.message.wrench.force.z == 1.0


def test_pub_fills_in_the_stamps_of_parts_in_a_list(other: ZmqBus, tactile: Tactile) -> None:
    subscription = other.subscribe('/tf_static', TF_STATIC.type_name, TF_STATIC.qos)
    parts = '{header: auto, child_frame_id: a}, {header: {stamp: now, frame_id: base}}'
    assert tactile('topic', 'pub', '-1', '/tf_static', TF_STATIC.type_name, f'{{transforms: [{parts}]}}').status == 0
    received = subscription.get(30.0)
    assert received is not None
    assert all(each.header.stamp.sec > 0 for each in received.message.transforms)
    assert received.message.transforms[1].header.frame_id == 'base'


@pytest.mark.parametrize(
    'words', [('echo', '/b', WRENCH, '--timeout', '0.1'), ('pub', '/b', WRENCH, '-1', '--max-wait-time-secs', '0.1')]
)
def test_the_wrong_type_of_a_topic_is_told(words: tuple[str, ...], other: ZmqBus, tactile: Tactile) -> None:
    other.advertise('/b', STRING, QUEUE)
    other.subscribe('/b', STRING, QUEUE)
    assert tactile('topic', *words).err.startswith(f'/b has the type {STRING}, not {WRENCH}\n')


@pytest.mark.parametrize(
    ('words', 'error'),
    [
        (('/b', 'std_msgs/msg/Sting'), "there is no message type 'std_msgs/msg/Sting'"),
        (('/b', STRING, '{date: x}'), "has no field 'date'; it has: data"),
        (('/b', STRING, 'hello'), "'hello' has no field names"),
        (('/b', STRING, '{data'), 'is not valid YAML'),
    ],
)
def test_pub_of_a_wrong_message_is_one_line(words: tuple[str, ...], error: str, tactile: Tactile) -> None:
    ended = tactile('topic', 'pub', '-1', *words)
    assert ended.status == 1
    assert error in ended.err
    assert ended.err.count('\n') == 1


def test_topics_of_another_process_are_seen(other: ZmqBus, tactile: Tactile) -> None:
    words = [sys.executable, '-m', 'tactile_nodes', 'topic', 'pub', '-r', '50', '/far', STRING, '{data: there}']
    with subprocess.Popen(words, stdout=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: '/far' in other.graph().topics(), timeout_s=60.0)
            printed = tactile('topic', 'echo', '/far', '--once').out
        finally:
            process.terminate()
    assert printed == 'data: there\n---\n'


# --- measuring --------------------------------------------------------------------------------------------------


def _received(arrival_ms: float, *, stamp_ms: float = 0.0, size: int = 0) -> Received:
    message = types.WrenchStamped(header=types.Header(stamp=time_from_ns(round(stamp_ms * MS))))
    arrival_ns = round(arrival_ms * MS)
    data = bytes(size) if size else None
    return Received(WRENCH, 'a.1', 1, arrival_ns, arrival_ns, message=None if size else message, data=data)


@pytest.mark.parametrize(
    ('window', 'arrivals_ms', 'report'),
    [
        # Intervals 10, 20, 10: mean 13.33 ms, deviation 4.714 ms.
        (100, (0, 10, 30, 40), '75.000\n\tmin: 0.010s max: 0.020s std dev: 0.00471s window: 3'),
        (1, (0, 1000, 1010), '100.000\n\tmin: 0.010s max: 0.010s std dev: 0.00000s window: 1'),
    ],
)
def test_the_rate_is_one_over_the_mean_interval_of_its_window(
    window: int, arrivals_ms: tuple[int, ...], report: str
) -> None:
    rate = Rate(window)
    for number, arrival_ms in enumerate(arrivals_ms):
        rate.add(_received(arrival_ms))
        if number == 0:
            assert rate.report(0) is None  # it needs two
    assert (rate.report(0), rate.report(0)) == (f'average rate: {report}', 'no new messages')


def test_the_delay_is_from_the_stamp_to_the_arrival() -> None:
    delay = Delay(100)
    delay.add(_received(110, stamp_ms=100))
    delay.add(_received(130, stamp_ms=110))
    assert delay.report(0) == ('average delay: 0.015000\n\tmin: 0.010000s max: 0.020000s std dev: 0.00500s window: 2')


def test_the_delay_needs_a_header() -> None:
    with pytest.raises(MessageError, match='has no header'):
        Delay(100).add(Received(STRING, 'a.1', 1, 0, 0, message=types.String()))


def test_the_bandwidth_is_all_bytes_of_the_window_until_now() -> None:
    bandwidth = Bandwidth(100)
    bandwidth.add(_received(0, size=1000))
    bandwidth.add(_received(500, size=3000))
    assert bandwidth.report(2_000 * MS) == (
        '2.00 KB/s from 2 messages\n\tMessage size mean: 2.00 KB min: 1.00 KB max: 3.00 KB'
    )


@pytest.fixture
def _wrenches(other: ZmqBus, repeating: Repeating) -> None:
    publisher = other.advertise('/w', WRENCH, QUEUE)
    repeating(lambda: publisher.publish(types.WrenchStamped(header=types.Header(stamp=time_from_ns(1)))))


@pytest.mark.usefixtures('_wrenches')
def test_measuring_reports_once_a_second_until_ctrl_c() -> None:
    words = [sys.executable, '-m', 'tactile_nodes', 'topic', 'hz', '/w']
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == 'Subscribed to [/w]\n'
        assert 'average rate: ' in process.stdout.readline()
        process.send_signal(2)
        assert process.wait(30.0) == 130
        assert process.stderr.read() == ''


class CtrlC(io.StringIO):
    """A terminal at which somebody presses Ctrl-C once the second line is there."""

    def write(self, text: str) -> int:
        ended, written = self.getvalue().count('\n') > 1, super().write(text)
        if self.getvalue().count('\n') > 1 and not ended:
            signal.raise_signal(signal.SIGINT)
        return written


@pytest.mark.usefixtures('_wrenches')
@pytest.mark.parametrize(('command', 'printed'), [('bw', '/s from '), ('delay', 'average delay')])
def test_each_measure_is_reported_in_its_own_words(command: str, printed: str) -> None:
    with contextlib.redirect_stdout(CtrlC()) as shown:
        assert main(['topic', command, '/w']) == 130
    assert printed in shown.getvalue().splitlines()[1]


def test_ctrl_c_counts_wherever_it_comes_and_a_second_one_at_once() -> None:
    """An exception that is raised where the memory of a picture is given back would only be printed."""

    class Memory:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with interruptible(lambda _: None) as get:
        assert get(0.0) is None
        Memory()
        with pytest.raises(KeyboardInterrupt):
            get(0.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
