"""A collection in simulated time: its bag is a real one, and a run that ended early goes on."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from benchmarks.collection import page_text
from benchmarks.collection.bag import CollectionBag
from tactile_nodes import messages
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FORCE_TORQUE, PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE, SYNC_EDGE
from tactile_nodes.cli.main import main
from tactile_nodes.clock import SteppedClock, monotonic_s
from tactile_nodes.collection.plan.audit import attempts_below, bags_below
from tactile_nodes.collection.plan.plan import PlanSettings, make_plan
from tactile_nodes.collection.run.run_messages import sample_message
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.conversions import image_array
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.messages import types
from tactile_nodes.simulation.gel import Gel

ROOT = Path(__file__).resolve().parents[2]
PLAN = PlanSettings(columns=2, rows=1, pitch_mm=6.0, depths_mm=(0.5, 1.5))
PRESSES = range(1, 5)
TICK = threading.Event()


def command(folder: Path) -> list[str]:
    plan = folder / 'plan.yaml'
    plan.write_text('columns: 2\nrows: 1\npitch_mm: 6.0\ndepths_mm: [0.5, 1.5]\n', encoding='ascii')
    return ['bench', 'collection', '--plan', str(plan), '-o', str(folder), '--rate', '100', '--fps', '10']


def collect(folder: Path) -> subprocess.Popen[bytes]:
    """The program, in a process of its own, which can be killed."""
    environment = {**os.environ, 'PYTHONPATH': str(ROOT), 'OPENBLAS_NUM_THREADS': '1'}
    words = [sys.executable, '-m', 'tactile_nodes', *command(folder)]
    return subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL)


def has_recorded(folder: Path) -> bool:
    """Whether the journal of a run in this folder tells of a press by now."""
    return any('"recorded"' in each.read_text(encoding='ascii') for each in folder.glob('*.jsonl'))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of four presses that was killed after the first, and then came to its end."""
    folder = tmp_path_factory.mktemp('run')
    deadline_s = monotonic_s() + 120
    with collect(folder) as program:
        while program.poll() is None and not has_recorded(folder) and monotonic_s() < deadline_s:
            TICK.wait(0.05)
        program.send_signal(signal.SIGKILL)
    assert main(command(folder)) == 0
    return folder


def presses_of(folder: Path) -> list[types.Press]:
    found = []
    for bag in bags_below(folder):
        with BagReader(bag) as reader:
            found += [reader.decode(message) for message in reader.messages(['/press'])]
    return found


def test_a_run_that_was_killed_and_started_again_holds_every_press_once(folder: Path) -> None:
    held = Counter(press for press, _ in attempts_below(folder, make_plan(PLAN).plan_id))
    assert held == dict.fromkeys(PRESSES, 1)


def test_the_result_tells_how_the_run_ended_and_what_is_on_the_disk(folder: Path) -> None:
    result = json.loads((folder / 'result.json').read_text(encoding='utf-8'))
    assert result['sessions'][-1]['ended'].startswith('the plan is done')
    assert '4 of 4 presses recorded' in page_text(result)
    assert result['disk_bytes'] == sum(each.stat().st_size for each in folder.glob('*/*.mcap'))


def test_stamps_of_a_later_session_come_after_those_of_the_earlier(folder: Path) -> None:
    times = []
    for bag in bags_below(folder):
        with BagReader(bag) as reader:
            stamps = [message.publish_ns for message in reader.messages(['/force_torque'])]
            times.append((min(stamps), max(stamps)))
    assert all(before[1] < after[0] for before, after in itertools.pairwise(times))


def test_a_bag_has_the_topics_of_a_collection(folder: Path) -> None:
    with BagReader(folder / 'collected_2') as reader:
        topics = (PRESS, PRESS_IMAGE, REFERENCE_IMAGE, FORCE_TORQUE, RIG_STATE, SYNC_EDGE)
        assert {f'/{topic.name}' for topic in topics} <= set(reader.metadata.topics)


def test_the_label_is_the_force_of_the_table_at_the_depth(folder: Path) -> None:
    table = contact_table(Gel())
    for press in presses_of(folder):
        if press.status == press.STATUS_RECORDED:
            # The surface is found to about 0.015 mm, and the table rises by at most 0.6 N/mm.
            assert -press.wrench.force.z == pytest.approx(table.force_at(press.depth * 1000), abs=0.01)
            assert press.indenter == 'sphere 1.2 mm'


def test_images_are_cropped_like_the_cameras_and_show_the_press(folder: Path) -> None:
    with BagReader(folder / 'collected_2') as reader:
        images = [image_array(reader.decode(message)) for message in reader.messages(['/press_image'])]
    assert {image.shape for image in images} == {(440, 440)}
    changes = [float(np.abs(image.astype(float) - images[0]).mean()) for image in images[1:]]
    assert max(changes) > 1.5 * min(changes)


def test_a_sample_is_written_as_its_message_would_be(tmp_path: Path) -> None:
    samples = [
        Sample((1.5, -2.0, value, 0.1, 0.2, -0.3), 946_684_800_123_456_789 + number, 0, 0, number, 0, 0, 0, ())
        for number, value in enumerate((0.25, float('nan')))
    ]
    bag = CollectionBag(tmp_path / 'bag', SteppedClock(1), 'plan', 'tip', (0.0, 0.0), 'none')
    for sample in samples:
        bag.sample(sample)
    bag.close()
    with BagReader(tmp_path / 'bag') as reader:
        found = [message.data for message in reader.messages(['/force_torque'])]
    assert found == [messages.encode(sample_message(sample, 'force_torque_sensor')) for sample in samples]
