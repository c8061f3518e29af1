"""`tactile bag`: what it prints, which flags it takes, and how it ends."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.cli import bag as command
from tactile_nodes.cli.bag import sessions
from tactile_nodes.cli.main import main
from tactile_nodes.cli.running.session import ended_by_signals, joined
from tactile_nodes.messages import types
from tactile_nodes.nodes.recorder import RecorderNode

FORCE = 'tactile_nodes/msg/ForceDistribution'
START_NS = 1_585_866_235_112_411_371
PROGRAM = """
import sys
from tactile_nodes.cli.main import main
sys.exit(main(['bag', *sys.argv[1:]]))
"""


@pytest.fixture(autouse=True)
def _in_utc(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv('TZ', 'UTC')
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def make(folder: Path, *totals: float) -> Path:
    """A bag of forces 1.5 s apart."""
    writer = BagWriter(folder)
    writer.add_topic(BagTopic.of_type('/force_distribution', FORCE))
    for number, total in enumerate(totals):
        now_ns = START_NS + number * 1_500_000_000
        header = types.Header(stamp=messages.time_from_ns(now_ns))
        writer.write(
            '/force_distribution', messages.encode(types.ForceDistribution(header=header, total=total)), now_ns, 0
        )
    writer.close()
    return folder


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser.parse_args(words)


def test_info_prints_the_lines_of_ros2_bag_info(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make(tmp_path / 'press', 0.5, 1.0)
    size = (folder / 'press_0.mcap').stat().st_size
    assert main(['bag', 'info', str(folder)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        '',
        'Files:             press_0.mcap',
        f'Bag size:          {size / 1024:.1f} KiB',
        'Storage id:        mcap',
        'Duration:          1.500000000s',
        'Start:             Apr  2 2020 22:23:55.112411371 (1585866235.112411371)',
        'End:               Apr  2 2020 22:23:56.612411371 (1585866236.612411371)',
        'Messages:          2',
        f'Topic information: Topic: /force_distribution | Type: {FORCE} | Count: 2 | Serialization Format: cdr',
        '',
    ]


def test_info_warns_when_metadata_and_files_differ(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make(tmp_path / 'press', 0.5, 1.0)
    metadata = folder / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('message_count: 2', 'message_count: 3'))
    assert main(['bag', 'info', str(folder)]) == 0
    assert capsys.readouterr().err == f'Warning: {metadata} states 3 messages, but the files hold 2\n'


@pytest.mark.parametrize(
    ('size', 'shown'), [(0, '0.0 B'), (1023, '1023.0 B'), (12880, '12.6 KiB'), (3 << 30, '3.0 GiB')]
)
def test_sizes_are_shown_as_ros2_bag_shows_them(size: int, shown: str) -> None:
    assert command.size_text(size) == shown


def test_compare_says_how_many_stamps_are_identical_and_exits_1_when_a_number_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, same, other = (make(tmp_path / name, 0.5, last) for name, last in (('a', 1.0), ('b', 1.0), ('c', 1.5)))
    assert main(['bag', 'compare', str(first), str(same)]) == 0
    assert capsys.readouterr().out == '2 of 2 common stamps bit-identical\n'
    assert main(['bag', 'compare', str(first), str(other)]) == 1
    assert capsys.readouterr().out.splitlines() == [
        '1 of 2 common stamps bit-identical',
        'numbers that differ (number of stamps): total (1); largest difference 0.5',
    ]


def test_record_takes_the_flags_of_ros2_bag_record() -> None:
    found = parsed('record', '-o', 'press', '-e', 'image', '-x', 'raw', '-b', '1000', '-d', '60', '/a', '/b')
    assert (found.output, found.regex, found.exclude, found.topics) == ('press', 'image', 'raw', ['/a', '/b'])
    assert (found.max_bag_size, found.max_bag_duration, found.all) == (1000, 60.0, False)


def test_play_takes_the_flags_of_ros2_bag_play() -> None:
    found = parsed('play', 'press', '-r', '2', '-l', '--start-offset', '3', '--remap', '/a:=/b', '--topics', '/a', '/c')
    assert (found.bag, found.rate, found.loop, found.start_offset) == ('press', 2.0, True, 3.0)
    assert (found.remap, found.topics, found.clock) == (['/a:=/b'], ['/a', '/c'], 0.0)
    assert parsed('play', 'press', '--clock').clock == 40.0
    assert parsed('play', 'press', '--clock', '100').clock == 100.0


def started(*words: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, '-c', PROGRAM, *words], stderr=subprocess.PIPE, text=True)


def test_keys_that_arrive_together_are_all_followed() -> None:
    pressed: list[str] = []
    done = threading.Event()

    def toggle_paused() -> None:
        pressed.append('space')
        done.set()

    player: Any = SimpleNamespace(
        playback=None, post=lambda act: act(), toggle_paused=toggle_paused, play_next=lambda: pressed.append('right')
    )
    reading, writing = os.pipe()
    os.write(writing, b'\x1b[C\x1b[Cx\x1b[C ')
    os.close(writing)
    gives_up = threading.Timer(5.0, done.set)
    gives_up.start()
    sessions._follow_keys(reading, player, done)
    gives_up.cancel()
    os.close(reading)
    assert pressed == ['right', 'right', 'right', 'space']


def test_a_terminal_or_connection_that_closes_ends_a_recording_which_says_what_was_written(tmp_path: Path) -> None:
    process = started('record', '-o', str(tmp_path / 'press'), '-a')
    printed = process.stderr.readline()
    while 'recording into' not in printed:
        printed += process.stderr.readline()
    os.kill(process.pid, signal.SIGHUP)
    printed += process.communicate(timeout=60)[1]
    with BagReader(tmp_path / 'press') as reader:
        assert reader.problems == []
        assert f'wrote {reader.extent.messages} messages' in printed
    assert process.returncode == 0


def test_a_recording_in_a_terminal_is_not_taken_for_the_recorder_of_a_launch_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    # Else the page's button could stop it, or be told that something is being recorded already.
    process = started('record', '-o', str(tmp_path / 'press'), '-a')
    while 'recording into' not in process.stderr.readline():
        pass
    with joined() as bus:
        graph = bus.graph()
    os.kill(process.pid, signal.SIGINT)
    assert ' messages' in process.communicate(timeout=60)[1]
    assert process.returncode == 0
    assert '/bag_recorder' in graph.nodes()
    assert graph.services('/recorder/stop') == []


def test_folder_that_exists_is_one_sentence_and_exit_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['bag', 'record', '-o', str(tmp_path)]) == 1
    assert capsys.readouterr().err == f'{tmp_path} already exists and is not overwritten; choose another name\n'


def test_a_recording_that_a_bug_ends_has_exit_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(RecorderNode, '_report_health', lambda self: 1 / 0)
    assert main(['bag', 'record', '-o', str(tmp_path / 'press')]) == 1
    assert 'ZeroDivisionError' in capsys.readouterr().err


def test_a_signal_that_comes_in_the_middle_of_waiting_for_one_is_heard() -> None:
    with ended_by_signals() as done:
        with done._cond:  # as the main thread holds it for an instant whenever it begins to wait, or is notified again
            signal.raise_signal(signal.SIGINT)
        assert done.wait(20.0)
