"""What is left of a bag after the process is killed or the disk is full: done for real, in processes of their own."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mcap.reader
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from tactile_nodes.bag import writer
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.clock import NS_PER_S

RECORDER = """
import os
import sys
from pathlib import Path

import numpy as np

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.clock import SystemClock
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types

{before}
try:
    writer, clock = BagWriter(Path({folder!r})), SystemClock()
    writer.add_topic(BagTopic.of_type('/image_raw', 'sensor_msgs/msg/Image'))
    data = messages.encode(types.Image(data=np.zeros({size}, np.uint8)))
    start_ns = clock.now_ns()
    for number in range({count}):
        clock.sleep_until(start_ns + number * 2_000_000)
        now_ns = clock.now_ns()
        writer.write('/image_raw', data, now_ns, now_ns, number)
        os.write(1, b'%d %d\\n' % (number, now_ns))  # the whole line at once, whatever Python buffers
        {each}
    writer.close()
except BagError as error:
    sys.exit(str(error))
"""


def recorder(folder: Path, *, size: int, count: int, before: str = '', each: str = '', **options) -> subprocess.Popen:
    program = RECORDER.format(folder=str(folder), size=size, count=count, before=before, each=each)
    return subprocess.Popen(
        [sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


ENDS_BEFORE_A_WRITE = """
import os, signal
last, write_ready = False, BagWriter._write_ready

def kill_or_write(self):
    os.write(1, b'write %d\\n' % SystemClock().now_ns())
    if last:
        os.kill(os.getpid(), signal.SIGKILL)
    write_ready(self)

BagWriter._write_ready = kill_or_write
"""


@pytest.fixture(scope='module')
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int], list[int]]:
    """A bag whose recorder got SIGKILL after 1.4 s in full flow, with times of what it had taken in, and of its writes.

    The thread that writes kills it, before its next write and so never within one: that leaves a file that is cut off
    (`test_reader`), 2 MB at a time here.
    """
    folder = tmp_path_factory.mktemp('bags') / 'press'
    process = recorder(
        folder, size=20_000, count=100_000, before=ENDS_BEFORE_A_WRITE, each='last = number == 700 or last'
    )
    lines = [line.split() for line in process.communicate()[0].splitlines()]
    assert process.returncode == -signal.SIGKILL
    given, writes = ([int(ns) for word, ns in lines if (word == 'write') is wanted] for wanted in (False, True))
    return folder, given, writes


def test_killed_recorder_loses_at_most_the_last_second(killed) -> None:
    """It writes several times a second, each time all but the last moment; what had come before its last write is kept.

    A busy machine may make it wait with a write: that is no fault of what it writes.
    """
    folder, given, writes = killed
    with BagReader(folder) as reader:
        found = [message.log_ns for message in reader.messages()]
    assert found == given[: len(found)]
    assert writer.FLUSH_EVERY_S * NS_PER_S + writer._HOLD_NS < 0.5 * NS_PER_S
    assert min(later - earlier for earlier, later in itertools.pairwise(writes)) < 1.5 * writer.FLUSH_EVERY_S * NS_PER_S
    taken = [earlier for earlier, later in itertools.pairwise(given) if later <= writes[-2]]  # the last one kills it
    assert set(found) >= {each for each in taken if each <= taken[-1] - writer._HOLD_NS}


def test_killed_bag_is_read_by_rosbags_as_folder_and_as_file(killed) -> None:
    folder, *_ = killed
    with BagReader(folder) as reader:
        count = reader.extent.messages
    for path in (folder, folder / 'press_0.mcap'):
        with Reader(path) as other:
            assert len(list(other.messages())) == count
    with AnyReader([folder]) as other:
        assert len([other.deserialize(data, where.msgtype) for where, _, data in other.messages()]) == count


def test_killed_bag_is_read_by_the_mcap_package(killed) -> None:
    folder, *_ = killed
    with BagReader(folder) as reader, (folder / 'press_0.mcap').open('rb') as file:
        assert len(list(mcap.reader.make_reader(file).iter_messages())) == reader.extent.messages


def test_damage_in_the_first_chunk_of_a_killed_bag_costs_that_chunk_only(killed, tmp_path: Path) -> None:
    folder, *_ = killed
    with BagReader(folder) as reader:
        content = list(reader.messages())
    data = bytearray((folder / 'press_0.mcap').read_bytes())
    data[data.index(content[0].data) + 100] ^= 1
    (tmp_path / 'damaged.mcap').write_bytes(data)
    with BagReader(tmp_path / 'damaged.mcap') as reader:
        found = list(reader.messages())
        assert 'its checksum is wrong' in reader.problems[0]
    assert len(content) / 2 < len(found) < len(content)  # a chunk is a fifth of a second of more than one
    assert found == content[-len(found) :]


SPLITTER = """
import os, signal, sys, time
from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagLimits, BagWriter
from tactile_nodes.messages import types

writer = BagWriter(sys.argv[1], limits=BagLimits(file_bytes=1))
writer.add_topic(BagTopic.of_type('/text', 'std_msgs/msg/String'))
for number in range(2):
    writer.write('/text', messages.encode(types.String(data=str(number))), 10**18 + number, 10**18)
    while writer.totals.messages <= number:
        time.sleep(0.001)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_recorder_killed_just_after_a_split_leaves_a_bag_that_names_all_its_files(tmp_path: Path) -> None:
    # Each message fills a file, and all is over before the second after which the metadata are written anyway.
    subprocess.run([sys.executable, '-c', SPLITTER, str(tmp_path / 'press')], check=False)
    with BagReader(tmp_path / 'press') as reader:
        assert [reader.decode(message).data for message in reader.messages()] == ['0', '1']


def check_ended_in_one_sentence(process: subprocess.Popen, folder: Path, reason: str) -> None:
    printed, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert errors.count('\n') == 1
    assert reason in errors
    with BagReader(folder) as reader:
        count = len(list(reader.messages()))
        assert f'holds the messages written before ({count})' in errors
        assert 0 < count < printed.count('\n')
    with Reader(folder / f'{folder.name}_0.mcap') as other:
        assert other.message_count == count


def test_file_at_its_limit_ends_in_one_sentence_and_a_readable_bag(tmp_path: Path) -> None:
    limit = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (6 << 20, 6 << 20))'  # one chunk of 4 MB fits
    process = recorder(tmp_path / 'press', size=20_000, count=1000, before=limit)
    check_ended_in_one_sentence(process, tmp_path / 'press', 'File too large')


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / 'disk'
    folder.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=6m', 'none', str(folder)]
    mount = subprocess.run(command, capture_output=True, check=False)
    if mount.returncode != 0:
        pytest.skip('only root can mount a small disk')
    yield folder
    subprocess.run(['umount', str(folder)], check=True)


def test_full_disk_ends_in_one_sentence_and_a_readable_bag(tiny_disk: Path) -> None:
    process = recorder(tiny_disk / 'press', size=20_000, count=1000)
    check_ended_in_one_sentence(process, tiny_disk / 'press', 'No space left on device')


@pytest.mark.skipif(os.getuid() != 0, reason='needs a second user')
def test_folder_without_permission_ends_in_one_sentence(tmp_path: Path) -> None:
    before = f'import os; os.setgroups([]); os.setgid(65534); os.chdir({str(tmp_path)!r}); os.setuid(65534)'
    tmp_path.chmod(0o755)
    for parent in tmp_path.parents[:3]:
        if parent.owner() == 'root' and parent.name.startswith('pytest'):
            parent.chmod(0o755)
    process = recorder(Path('press'), size=10, count=1, before=before)
    assert process.communicate(timeout=120)[1] == 'cannot create the folder press for the bag: Permission denied\n'
    assert process.returncode == 1
