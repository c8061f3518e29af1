"""Bags whose recorders had clocks of their own, and the data sets that come of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from press_bags import DEPTHS_MM, PERIOD_NS, PLACES_MM, SECOND_NS, START_NS, Collection, Sensor
from told import Told

from benchmarks.devices.sync_line import RecorderFaults, recorded
from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FORCE_TORQUE, PRESS_IMAGE, REFERENCE_IMAGE, SYNC_EDGE, Topic
from tactile_nodes.collection.press.sync_pattern import pattern_gaps
from tactile_nodes.conversions import header
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.world import Edge
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.datasets.report import report
from tactile_nodes.learning.recorded import exclusions
from tactile_nodes.learning.recorded.bags import CollectionBag
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.learning.recorded.clocks import Edges, bag_clocks, fitted
from tactile_nodes.messages import types

pytestmark = pytest.mark.usefixtures('own_cache')

COARSE = BuildOptions(encoding=Choice('cartesian_mean', {'rows': 20, 'cols': 20}), without_contact=0.2)
OFF = DeviceClock(1e9, START_NS, START_NS - 300_000_000, 100.0, 64)
"""A clock that reads 0.3 s less than the host's when the run begins, and gains 100 ppm."""
FAULTS = RecorderFaults(missing=0.05, doubled=0.05, jitter_s=0.001)
SAME: Callable[[int], int] = lambda time_ns: time_ns  # noqa: E731


def read(clock: DeviceClock, time_ns: int) -> int:
    return clock.offset + clock.count(time_ns)


@dataclass
class SeveralClocks(Collection):
    """A collection whose images, and whose force samples, are stamped by clocks of their own."""

    camera_ns: Callable[[int], int] = SAME

    def __post_init__(self) -> None:
        super().__post_init__()
        for topic in (SYNC_EDGE, FORCE_TORQUE):
            self.writer.add_topic(BagTopic.of_type(self._name(topic), topic.type_name))

    def edges(self, recorder: str, seen: Sequence[tuple[int, bool]], half_s: float = 0.001) -> None:
        for number, (stamp_ns, level) in enumerate(seen):
            head = header(stamp_ns, recorder)
            edge = types.SyncEdge(header=head, line='press', level=level, count=number + 1, uncertainty=half_s)
            self._write(SYNC_EDGE, edge)

    def sample(self, uncorrected_ns: int, force_n: float) -> None:
        wrench = types.Wrench(force=types.Vector3(z=force_n))
        self._write(
            FORCE_TORQUE, types.WrenchStamped(header=header(uncorrected_ns, 'force_torque_sensor'), wrench=wrench)
        )

    def _write(self, topic: Topic, message: Any, log_ns: int | None = None) -> None:
        if topic in (PRESS_IMAGE, REFERENCE_IMAGE):
            stamp_ns = messages.stamp_ns(message.header.stamp)
            message = dataclasses.replace(message, header=header(self.camera_ns(stamp_ns), 'camera'))
            log_ns = stamp_ns + 5_000_000
        super()._write(topic, message, log_ns)


def line(presses: int = 12) -> list[Edge]:
    """What the rig switches: a pattern, each window of the collection, and another pattern."""
    start = START_NS - 30 * SECOND_NS + np.round(np.cumsum(pattern_gaps('a1b2c3d4e5f6', 0, 20)) * 1e9)
    during = [
        START_NS + slot * PERIOD_NS + 3 * SECOND_NS + part for slot in range(presses) for part in (0, 200_000_000)
    ]
    end = during[-1] + np.round(np.cumsum(pattern_gaps('a1b2c3d4e5f6', 13, 20)) * 1e9)
    times = [int(each) for each in (*start, *during, *end)]
    return [Edge(time_ns, number % 2 == 0) for number, time_ns in enumerate(times)]


def seen_by(clock: DeviceClock | None, edges: Sequence[Edge], faults: RecorderFaults = FAULTS, seed: int = 1):  # type: ignore[no-untyped-def]
    return recorded(edges, clock or DeviceClock(1e9, bits=64), faults, seed)


def collection(folder: Path, sensor: Sensor, clock: DeviceClock | None, camera_sees: bool = True) -> Path:
    """Twelve presses; the camera's stamps and edges are of a clock of its own, if one is given."""
    sensor.begin_anew()
    made = SeveralClocks(folder, sensor, camera_ns=SAME if clock is None else lambda time_ns: read(clock, time_ns))
    made.edges('rig', seen_by(None, line(), RecorderFaults(jitter_s=0.0005)), 0.0005)
    if camera_sees:
        made.edges('camera', seen_by(clock, line()))
    plan = [(*place, depth) for place in PLACES_MM for depth in DEPTHS_MM]
    for slot, (x_mm, y_mm, depth_mm) in enumerate(plan):
        if slot in (0, 6):
            made.reference(slot)
        made.press(slot, slot + 1, x_mm, y_mm, depth_mm)
    return made.close()


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('clocks')


@pytest.fixture(scope='module')
def plain(folder: Path, sensor: Sensor, own_cache: Path) -> RecordedPresses:
    """Nobody but the rig sees the line."""
    return build([collection(folder / 'plain', sensor, None, camera_sees=False)], COARSE)


@pytest.fixture(scope='module')
def equal(folder: Path, sensor: Sensor, own_cache: Path) -> RecordedPresses:
    return build([collection(folder / 'equal', sensor, None)], COARSE)


@pytest.fixture(scope='module')
def foreign(folder: Path, sensor: Sensor, own_cache: Path) -> RecordedPresses:
    return build([collection(folder / 'foreign', sensor, OFF)], COARSE)


def test_equal_clocks_change_not_a_bit(plain: RecordedPresses, equal: RecordedPresses) -> None:
    ours, theirs = plain.arrays(), equal.arrays()
    assert all(ours[name].tobytes() == theirs[name].tobytes() for name in ours)
    assert [clock['corrected'] for clock in equal.card['bags'][0]['clocks']] == [False]


def test_a_camera_with_a_clock_of_its_own_gives_the_same_data_set(
    equal: RecordedPresses, foreign: RecordedPresses
) -> None:
    """0.3 s and 100 ppm off, 5 % of its edges missing and 5 % doubled."""
    ours, theirs = equal.arrays(), foreign.arrays()
    stamps = {'stamp_ns', 'window_ns'}  # those of untouched images are stamps
    for name in sorted(ours.keys() - stamps):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    for name in stamps:
        assert np.abs(ours[name] - theirs[name]).max() < 2_000_000
    assert foreign.card['left_out'] == [] and (~foreign.contact).any()


def test_the_card_tells_offset_drift_and_residuals(foreign: RecordedPresses) -> None:
    (entry,) = foreign.card['bags'][0]['clocks']
    assert entry['recorder'] == 'camera' and entry['corrected']
    # At the middle of the run, some 30 s after its start, 100 ppm are 3 ms of the 0.3 s.
    assert entry['offset_s'] == pytest.approx(0.297, abs=0.002)
    assert entry['drift_ppm'] == pytest.approx(-100, abs=25)
    assert 0 < entry['residual_median_s'] < entry['residual_max_s'] < 0.002
    assert entry['bound_s'] <= 0.002
    assert 'camera: +0.29' in report(foreign) and 'corrected' in report(foreign)


def test_a_clock_that_cannot_be_fitted_is_a_warning_and_changes_nothing(
    tmp_path: Path, sensor: Sensor, plain: RecordedPresses
) -> None:
    made = begun(tmp_path / 'few', sensor, presses=2, camera=seen_by(None, line(2))[:5])
    for slot in range(2):
        made.press(slot, slot + 1, 0.0, 0.0, 1.0)
    told = Told()
    found = build([made.close()], COARSE, told)
    (entry,) = found.card['bags'][0]['clocks']
    assert entry['refused'] == 'too few edges' and not entry['corrected']
    words = 'the clock of camera could not be compared with that of rig: too few edges seen by both to synchronise: 5, '
    assert any(words in text for text in told.lines)
    assert 'camera: not known, 5 edges' in report(found)
    assert found.stamp_ns[0] == START_NS + 3 * SECOND_NS


def begun(folder: Path, sensor: Sensor, presses: int = 12, **edges: Sequence[tuple[int, bool]]) -> SeveralClocks:
    """A collection with a rest image, after edges that the rig and others saw."""
    sensor.begin_anew()
    made = SeveralClocks(folder, sensor)
    made.edges('rig', seen_by(None, line(presses)))
    for recorder, seen in edges.items():
        made.edges(recorder, seen)
    made.reference(0)
    return made


def stamped_late(folder: Path, sensor: Sensor, late_ns: int) -> Path:
    """One press, of which the rig chose the images by the stamps of a clock that is late."""
    late = DeviceClock(1e9, START_NS, START_NS + late_ns, 0.0, 64)
    made = begun(folder, sensor, camera=seen_by(late, line()))
    made.press(0, 1, 0.0, 0.0, 1.0)
    return made.close()


def test_images_that_the_rig_took_by_a_wrong_clock_are_left_out(tmp_path: Path, sensor: Sensor) -> None:
    """By the corrected clock they were taken 0.3 s before the window."""
    with pytest.raises(DatasetError, match=exclusions.OTHER_TIME):
        build([stamped_late(tmp_path / 'live', sensor, 300_000_000)], COARSE)


def test_images_at_the_border_of_a_window_go_and_the_others_stay(tmp_path: Path, sensor: Sensor) -> None:
    """Stamped 10 ms late, the first image of the window was taken before it."""
    bag = stamped_late(tmp_path / 'late', sensor, 10_000_000)
    assert build([bag], dataclasses.replace(COARSE, frames='mean', without_contact=0.0)).frames.tolist() == [2]


def force_bag(folder: Path, sensor: Sensor, sensor_sees: bool) -> Path:
    """A force that rises by 1 N/s, stamped by a clock that is 0.3 s behind; the rig took samples by their stamps."""
    behind = DeviceClock(1e9, START_NS, START_NS - 300_000_000, 0.0, 64)
    made = begun(folder, sensor, **({'force_torque_sensor': seen_by(behind, line())} if sensor_sees else {}))
    begin_ns, end_ns = made.window_ns(0)
    times = range(begin_ns - SECOND_NS, end_ns + SECOND_NS, 5_000_000)
    force = {time_ns: 0.5 + (time_ns - begin_ns) / SECOND_NS for time_ns in times}
    for time_ns, value in force.items():
        made.sample(read(behind, time_ns), value)
    taken = [value for time_ns, value in force.items() if begin_ns <= read(behind, time_ns) <= end_ns]
    tare = types.Wrench(force=types.Vector3(z=0.1))
    wrench = types.Wrench(force=types.Vector3(x=0.01, z=-(float(np.mean(taken)) - 0.1)))
    made.press(0, 1, 0.0, 0.0, 1.0, tare=tare, wrench=wrench)
    return made.close()


@pytest.mark.parametrize('namespace', [None, '/'])
def test_a_force_sensor_with_a_clock_of_its_own_gets_the_force_of_the_window(
    tmp_path: Path, sensor: Sensor, namespace: str | None
) -> None:
    """In the middle of the window of 50 ms the force is 0.525 N, less the tare of 0.1 N; the rig had 0.3 N more."""
    with CollectionBag(force_bag(tmp_path / 'ft', sensor, sensor_sees=True), namespace) as bag:
        (press,) = bag.presses()
    assert exclusions.force_n(press.message) == pytest.approx(0.425, abs=0.005)
    assert press.message.force_rate == pytest.approx(1.0, abs=1e-6)
    assert press.message.samples == pytest.approx(10, abs=1)
    assert np.isnan(press.message.wrench.force.x)


def test_a_force_sensor_without_edges_keeps_what_the_rig_said(tmp_path: Path, sensor: Sensor) -> None:
    with CollectionBag(force_bag(tmp_path / 'ft', sensor, sensor_sees=False)) as bag:
        (press,) = bag.presses()
    assert exclusions.force_n(press.message) == pytest.approx(0.725, abs=0.005)
    assert press.message.wrench.force.x == 0.01


def test_another_recorder_can_be_the_reference(folder: Path, foreign: RecordedPresses) -> None:
    with BagReader(folder / 'foreign') as reader:
        clocks = bag_clocks(reader, reference='camera')
        (entry,) = clocks.as_list()
        assert entry['recorder'] == 'rig' and entry['offset_s'] == pytest.approx(-0.297, abs=0.002)
        with pytest.raises(DatasetError, match="no edges of 'moon'; recorders in it are: camera, rig"):
            bag_clocks(reader, reference='moon')


def edges_of(seen: Sequence[tuple[int, bool]], half_s: float) -> Edges:
    stamps, levels = zip(*seen, strict=True)
    return Edges(np.array(stamps, np.int64), np.array(levels, bool), np.full(len(stamps), half_s))


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    seed=st.integers(0, 10_000),
    presses=st.integers(9, 150),
    ahead_s=st.floats(-0.3, 0.3),
    drift_ppm=st.floats(-100, 100),
    missing=st.floats(0, 0.05),
    doubled=st.floats(0, 0.05),
)
def test_what_the_rig_switches_brings_a_recorder_to_its_clock_within_2_ms(
    seed: int, presses: int, ahead_s: float, drift_ppm: float, missing: float, doubled: float
) -> None:
    """Presses that are all alike between two patterns; 1 ms of jitter in the recorder, half in the rig."""
    edges = line(presses)
    clock = DeviceClock(1e9, START_NS, START_NS + round(ahead_s * 1e9), drift_ppm, 64)
    rig = edges_of(seen_by(None, edges, RecorderFaults(jitter_s=0.0005), seed + 1), 0.0005)
    other = edges_of(seen_by(clock, edges, RecorderFaults(missing, doubled, 0.001), seed), 0.001)
    clocks = fitted({'rig': rig, 'other': other}, 'rig')
    assert not clocks.warnings
    for time_ns in np.linspace(edges[0].stamp_ns, edges[-1].stamp_ns, 30).astype(int).tolist():
        assert abs(clocks.corrected_ns(read(clock, time_ns), 'other') - time_ns) < 2_000_000


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 10_000))
def test_a_recorder_of_another_run_is_refused(seed: int) -> None:
    ours = edges_of(seen_by(None, line(20)), 0.001)
    gaps = np.random.default_rng(seed).uniform(0.4, 2.5, 60)
    stamps = START_NS + np.round(np.cumsum(gaps) * 1e9).astype(np.int64)
    clocks = fitted({'rig': ours, 'other': Edges(stamps, np.arange(60) % 2 == 0, np.full(60, 0.001))}, 'rig')
    assert len(clocks.warnings) == 1
    assert clocks.corrected_ns(5, 'other') == 5
