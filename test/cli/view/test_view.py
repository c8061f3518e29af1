"""The view on a real bus, and in front of a launch."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console
from running_system import Tactile, wait_until
from seen import diagnostics, force, received

from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.cli import view
from tactile_nodes.cli.launch.view import Notes, is_worth_seeing
from tactile_nodes.launching.processes.output import Line
from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.viewing.state import ViewState

Repeating = Callable[..., None]


def publish_forces(bus: ZmqBus, repeating: Repeating, namespace: str = '') -> None:
    topic = topics.FORCE_DISTRIBUTION
    publisher = bus.advertise(f'{namespace}/{topic.name}', topic.type_name, topic.qos, '/force_estimator')

    def act() -> None:
        header = types.Header(stamp=time_from_ns(bus.clock.now_ns()))
        publisher.publish(types.ForceDistribution(header=header, rows=2, cols=2, normal_force=force(0).normal_force))

    repeating(act, 0.05)


def test_the_plain_view_of_a_namespace_sees_its_forces_and_ends_in_a_summary(
    other: ZmqBus, tactile: Tactile, repeating: Repeating
) -> None:
    publish_forces(other, repeating, '/left')
    ended = tactile('view', '--plain', '--duration', '4.1', '--namespace', 'left')
    assert ended.status == 0
    assert ' fps  force  0.000 N' in ended.out
    assert 'lost in transit' in ended.out


def test_a_view_of_nothing_says_what_is_missing(tactile: Tactile) -> None:
    ended = tactile('view', '--plain', '--duration', '1.1')
    assert ended.status == 0
    assert '/force_distribution has no publisher' in ended.out


def test_a_view_that_finds_nothing_says_where_there_are_sensors(
    other: ZmqBus, tactile: Tactile, repeating: Repeating
) -> None:
    publish_forces(other, repeating, '/left')
    ended = tactile('view', '--plain', '--duration', '2.1')
    assert 'sensors are at /left: tactile view --namespace /left' in ended.out


def test_where_no_terminal_can_draw_the_address_of_the_page_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    state, show = ViewState(), view._printing()
    for watching in (0, 0, 1):
        page = f'http://127.0.0.1:7470/, viewers: {watching}'
        state.add_diagnostics(received(diagnostics(('live_view: page', 0, page)), 25))
        show(state.snapshot(30))
    assert capsys.readouterr().out.splitlines().count('page: http://127.0.0.1:7470/') == 1


def test_all_sensors_of_a_hand_are_seen_together(other: ZmqBus, tactile: Tactile, repeating: Repeating) -> None:
    for namespace in ('/left', '/right'):
        publish_forces(other, repeating, namespace)
    ended = tactile('view', '--plain', '--duration', '3.1')
    assert 'left 0.000 N OK  right 0.000 N OK  sum no data: nothing comes on hand_wrench' in ended.out
    rows = {
        words[0]: int(words[1])
        for line in ended.out.splitlines()
        if (words := line.split())[:1] in (['left'], ['right'])
    }
    assert min(rows['left'], rows['right']) > 0


def test_the_only_sensor_of_a_hand_that_has_started_is_seen(
    other: ZmqBus, tactile: Tactile, repeating: Repeating
) -> None:
    publish_forces(other, repeating, '/left')
    other.advertise('/hand_wrench', topics.HAND_WRENCH.type_name, topics.HAND_WRENCH.qos, '/hand_wrench')
    ended = tactile('view', '--plain', '--duration', '3.1')
    assert 'left 0.000 N OK  sum no data' in ended.out


def test_the_sum_of_a_hand_in_a_namespace_is_seen_from_above_it(other: ZmqBus) -> None:
    state = view.new_state(other)
    made = other.advertise('/robot/hand_wrench', topics.HAND_WRENCH.type_name, topics.HAND_WRENCH.qos)
    watch = view.Watch(other, state)
    watch.drain(other.clock.now_ns())

    def seen() -> bool:
        made.publish(types.HandWrench(sensors=['left']))
        watch.drain(other.clock.now_ns())
        return state.snapshot(other.clock.now_ns()).wrench is not None

    wait_until(seen)
    watch.close()


def test_a_view_of_a_sensor_that_is_missing_does_not_show_others_in_its_place(
    other: ZmqBus, tactile: Tactile, repeating: Repeating
) -> None:
    for namespace in ('', '/left'):
        publish_forces(other, repeating, namespace)
    ended = tactile('view', '--plain', '--duration', '2.1', '--namespace', '/middle')
    assert 'sensors are at /, /left: tactile view --namespace /' in ended.out
    assert '0.000 N' not in ended.out


def test_the_drawn_view_stops_when_told(other: ZmqBus, repeating: Repeating, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TERM', 'xterm-256color')  # where it is dumb nothing can be drawn
    publish_forces(other, repeating)
    stop = threading.Event()
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=100, height=30)
    state = view.new_state(other)
    shown = threading.Thread(
        target=lambda: view.run_view(other, state, plain=False, stop=stop, console=console), name='view'
    )
    shown.start()
    wait_until(lambda: 'latency [ms]' in file.getvalue())
    stop.set()
    shown.join(30.0)
    assert not shown.is_alive()


def in_a_terminal(term: str, until: bytes, *words: str) -> str:
    """What `tactile` writes on a terminal that says what it is by TERM, until that comes and Ctrl-C."""
    ours, theirs = os.openpty()
    command = [sys.executable, '-m', 'tactile_nodes', *words]
    environment = {**os.environ, 'TERM': term}
    with subprocess.Popen(command, stdout=theirs, stderr=subprocess.PIPE, env=environment) as process:
        assert process.stderr is not None
        os.close(theirs)
        output = b''
        with contextlib.suppress(OSError):  # EIO: nobody has the other end any more
            while more := os.read(ours, 4096):
                seen, output = until in output, output + more
                if until in output and not seen:
                    process.send_signal(signal.SIGINT)
        os.close(ours)
        assert (process.wait(60.0), process.stderr.read()) == (0, b'')
    return output.decode()


@pytest.mark.parametrize('environment', [{}, {'TERM': ''}, {'TERM': 'dumb'}, {'TERM': 'unknown'}])
def test_a_terminal_that_does_not_say_what_it_is_cannot_draw(environment: dict[str, str]) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, 'w') as terminal:
        assert not view.can_draw(terminal, environment)
        assert view.can_draw(terminal, {'TERM': 'xterm'})
    os.close(ours)


def test_a_terminal_that_cannot_draw_gets_lines(other: ZmqBus, repeating: Repeating) -> None:
    publish_forces(other, repeating)
    output = in_a_terminal('dumb', b' fps  force  0.000 N  contact none', 'view', '--duration', '60')
    assert 'frames in' in output
    assert '\x1b' not in output


def test_a_terminal_that_can_draw_gets_the_picture(other: ZmqBus, repeating: Repeating) -> None:
    publish_forces(other, repeating)
    assert '\x1b[' in in_a_terminal('xterm-256color', b'latency [ms]', 'view', '--duration', '60')


def test_lines_tell_what_nodes_warn_of_once(other: ZmqBus, capsys: pytest.CaptureFixture[str]) -> None:
    state = view.new_state(other)
    state.add_note('[WARN] [camera]: dark')
    show = view._printing()
    show(state.snapshot(0))
    show(state.snapshot(1))
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if 'no force yet' not in line] == ['[WARN] [camera]: dark']
    assert len(lines) == 3


def test_bytes_that_are_no_force_are_counted(other: ZmqBus) -> None:
    topic = topics.FORCE_DISTRIBUTION
    state = view.new_state(other)
    feeds = view.Watch(other, state)
    other.advertise('/force_distribution', topic.type_name, topic.qos).publish_bytes(b'\x00\x01\x00\x00rubbish')
    feeds.drain(0)
    feeds.close()
    shot = state.snapshot(0)
    assert (shot.malformed, shot.frames) == (1, 0)


def test_every_force_is_counted_however_many_come_between_two_looks(other: ZmqBus) -> None:
    topic = topics.FORCE_DISTRIBUTION
    state = view.new_state(other)
    feeds = view.Watch(other, state)
    publisher = other.advertise('/force_distribution', topic.type_name, Qos('queue', 100))
    for number in range(50):
        publisher.publish(force(number))
    feeds.drain(0)
    feeds.close()
    assert state.snapshot(0).frames == 50
    assert received(force(0)).sequence == 1


@pytest.mark.parametrize(
    ('line', 'seen'),
    [
        (Line('launch', 'All log files can be found below', 'INFO'), False),
        (Line('camera_node-1', 'process has died', 'ERROR'), True),
        (Line('camera_node-1', '[WARN] [12.3] [camera]: dark', '', 'stderr'), False),
        (Line('camera_node-1', 'camera: /dev/video0 is not there', '', 'stderr'), True),
        (Line('camera_node-1', 'hello', '', 'stdout'), False),
    ],
)
def test_in_front_of_a_launch_only_what_matters_is_shown(line: Line, seen: bool) -> None:
    assert is_worth_seeing(line) == seen


def test_notes_reach_the_view_and_are_kept_for_the_end() -> None:
    shown: list[str] = []
    notes = Notes()
    notes.tell = shown.append
    notes(Line('a-1', 'process has died [pid 7, exit code 1].', 'ERROR'))
    assert shown == list(notes.lines) == ['[ERROR] [a-1]: process has died [pid 7, exit code 1].']


def launch(run_folder: Path, tmp_path: Path, *commands: str, errors: int = subprocess.PIPE) -> subprocess.Popen[str]:
    """``tactile launch --view`` of these commands, each of which is required."""
    text = 'launch:\n' + ''.join(
        f"  - executable: {{cmd: '{command}', on_exit: shutdown, output: screen}}\n" for command in commands
    )
    file = tmp_path / 'test.launch.yaml'
    file.write_text(text)
    environment = {**os.environ, 'ROS_LOG_DIR': str(tmp_path / 'log')}
    words = [sys.executable, '-m', 'tactile_nodes', 'launch', '--view', str(file)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)


def test_in_front_of_a_launch_the_cause_is_the_last_line_after_where_the_logs_are(
    run_folder: Path, tmp_path: Path
) -> None:
    command = 'sh -c "echo the lamp is broken >&2; exit 3"'
    with launch(run_folder, tmp_path, command, errors=subprocess.STDOUT) as process:
        lines = process.communicate(timeout=30)[0].splitlines()
    assert process.returncode == 1
    assert lines[-1] == '[ERROR] [launch]: sh-1 failed: the lamp is broken'
    assert sum(line.startswith('logs: ') for line in lines) == 1


def test_ctrl_c_in_front_of_a_launch_ends_both(run_folder: Path, tmp_path: Path) -> None:
    with launch(run_folder, tmp_path, 'sleep 60') as process:
        assert process.stdout is not None
        assert 'no force yet' in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0
    assert 'logs: ' in out
    assert 'Traceback' not in err


def test_a_wrong_launch_file_is_reported_before_the_view_begins(run_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / 'test.launch.yaml'
    file.write_text('launch:\n  - nonsense: {}\n')
    words = [sys.executable, '-m', 'tactile_nodes', 'launch', '--view', str(file)]
    environment = {**os.environ, 'ROS_LOG_DIR': str(tmp_path / 'log')}
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    assert (ended.returncode, ended.stdout) == (1, '')
    assert f'{file}:2' in ended.stderr
    assert ended.stderr.count('\n') == 1
