"""What a recording tells of a take-over, by a bag written by hand: ten frames, one lost, and a press of each model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.take_over import page, read, rows
from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import FLOW_FEATURES, FORCE_DISTRIBUTION, PRESS
from tactile_nodes.conversions import header
from tactile_nodes.messages import time_from_ns, types

START_NS, FRAME_NS = 1_700_000_000_000_000_000, 2_000_000_000
LOST, TAKEN_OVER = 3, 6


def stamp(frame: int) -> int:
    return START_NS + frame * FRAME_NS


def force(frame: int) -> types.ForceDistribution:
    """Of 1 N at (2, 0) mm the old model says 1.3 N at (5, 4) mm, the new one 0.9 N at the place."""
    old = frame < TAKEN_OVER
    return types.ForceDistribution(
        header=header(stamp(frame), 'gel_surface'),
        normal_force=np.zeros(0, np.float32),
        confidence=np.zeros(0, np.float32),
        total=1.3 if old else 0.9,
        contact=types.Point(x=0.005, y=0.004) if old else types.Point(x=0.002, y=0.0),
        provenance=types.Provenance(model='old' if old else 'new', model_id='aaaa' if old else 'bbbb'),
    )


def press(frame: int) -> types.Press:
    return types.Press(
        window_start=time_from_ns(stamp(frame) - 1), window_end=time_from_ns(stamp(frame) + 1),
        position=types.Point(x=0.002), wrench=types.Wrench(force=types.Vector3(z=-1.0)),
    )  # fmt: skip


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    writer = BagWriter(tmp_path / 'recorded')
    for topic in (FLOW_FEATURES, FORCE_DISTRIBUTION, PRESS):
        writer.add_topic(BagTopic.of_type(f'/{topic.name}', topic.type_name))
    nothing = np.zeros(0, np.float32)
    for frame in range(10):
        features = types.FlowFeatures(header=header(stamp(frame), 'camera'), values=nothing, confidence=nothing)
        writer.write(f'/{FLOW_FEATURES.name}', messages.encode(features), stamp(frame), stamp(frame))
        if frame != LOST:
            writer.write(f'/{FORCE_DISTRIBUTION.name}', messages.encode(force(frame)), stamp(frame), stamp(frame))
    for frame in (1, LOST, 8):
        writer.write(f'/{PRESS.name}', messages.encode(press(frame)), stamp(9), stamp(9))
    writer.close()
    return tmp_path / 'recorded'


def test_each_model_is_judged_by_the_presses_of_its_time(bag: Path) -> None:
    old, new = rows(read(bag))
    assert (old.model, old.frames, old.presses) == ('old', TAKEN_OVER - 1, 1)  # of the second press no frame is left
    assert (old.rmse_n, old.place_mm) == pytest.approx((0.3, 5.0))
    assert (new.model, new.frames, new.presses) == ('new', 4, 1)
    assert (new.rmse_n, new.place_mm) == pytest.approx((0.1, 0.0))


def test_a_frame_without_a_force_is_counted_where_it_was_lost(bag: Path) -> None:
    recording = read(bag)
    assert recording.taken_over_ns == [stamp(TAKEN_OVER)]
    assert recording.lost_ns == [stamp(LOST)]
    assert recording.lost_beside == 0
    assert page(recording).endswith('1 take-overs; frames lost within a second of one: 0; else: 1 of 10.')
