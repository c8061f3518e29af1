"""From bags to samples: what belongs together, which rest image applies, and what is left out for which reason."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from press_bags import DEPTHS_MM, FRAME_NS, FRAMES, PLACES_MM, SECOND_NS, START_NS, Collection, Sensor
from told import Told

from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE
from tactile_nodes.conversions import image_array
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.recordings import RETRIED, RecordedPresses
from tactile_nodes.learning.recorded import exclusions
from tactile_nodes.learning.recorded.bags import CollectionBag
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.messages import types
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.rest.reference import average

pytestmark = pytest.mark.usefixtures('own_cache')

COARSE = BuildOptions(encoding=Choice('cartesian_mean', {'rows': 20, 'cols': 20}), frames='mean', without_contact=0.0)


@pytest.fixture(scope='module')
def presses(bag: Path, own_cache: Path) -> RecordedPresses:
    return build([bag], COARSE)


@pytest.fixture
def collection(tmp_path: Path, sensor: Sensor) -> Collection:
    """A bag to be written; it begins with a rest image."""
    sensor.begin_anew()
    made = Collection(tmp_path / 'odd', sensor)
    made.reference(0)
    return made


def left_out(presses: RecordedPresses) -> list[tuple[int, int, str]]:
    return [(each['press'], each['attempt'], each['reason']) for each in presses.card['left_out']]


def test_every_good_press_becomes_a_sample(presses: RecordedPresses) -> None:
    assert presses.press.tolist() == list(range(1, 13))
    assert presses.card['left_out'] == []
    assert presses.features.shape == (12, 20, 20, 2)


def test_place_and_depth_are_those_of_the_plan_in_millimetres(presses: RecordedPresses) -> None:
    plan = [(*place, depth) for place in PLACES_MM for depth in DEPTHS_MM]
    assert np.column_stack([presses.position_mm, presses.depth_mm]).tolist() == [list(each) for each in plan]


def test_force_into_the_gel_is_positive(presses: RecordedPresses, sensor: Sensor) -> None:
    expected = [sensor.table.force_at(depth) for _ in PLACES_MM for depth in DEPTHS_MM]
    np.testing.assert_allclose(presses.force_n, expected)
    np.testing.assert_allclose(presses.wrench[:, 2], -presses.force_n)


def test_the_whole_force_is_in_the_bin_of_the_centre(presses: RecordedPresses) -> None:
    """Bins of 32/9 mm: (-3, -3) mm is in column and row int((16 - 3) / 3.556) = 3, (1.5, 3) in column 4 of row 5."""
    np.testing.assert_allclose(presses.labels.sum(axis=1), presses.force_n, rtol=1e-6)
    assert presses.labels[0].argmax() == 3 * 9 + 3
    assert presses.labels[11].argmax() == 5 * 9 + 4


def test_another_reading_of_the_bins_gives_other_labels(bag: Path) -> None:
    """9x9 over 27 mm: (1.5, 3) lies on the border of columns 4 and 5 and belongs to 5; row int(16.5 / 3) = 5."""
    found = build([bag], dataclasses.replace(COARSE, bins=BinGrid(9, 9, 27.0, 27.0)))
    assert found.labels[11].argmax() == 5 * 9 + 5
    assert '27x27 mm' in found.card['labels']['reading']


def test_stamps_are_those_of_capture(presses: RecordedPresses) -> None:
    first = START_NS + 3 * SECOND_NS
    assert presses.stamp_ns[0] == first
    assert presses.window_ns[0].tolist() == [first, first + FRAMES * FRAME_NS]
    assert (presses.frames == FRAMES).all()


def test_features_are_measured_against_the_rest_image_of_the_time(bag: Path, presses: RecordedPresses) -> None:
    """By hand for the seventh press: second rest image, mean of the window's images."""
    with BagReader(bag) as reader:
        rests = [reader.decode(each) for each in reader.messages([f'/{REFERENCE_IMAGE.name}'])]
    with CollectionBag(bag) as opened:
        seventh = list(opened.presses())[6]
    flow, encoding = make_flow('dis'), make_encoding('cartesian_mean', {'rows': 20, 'cols': 20})
    flow.set_reference(image_array(rests[1]))
    window = average([frame.image for frame in seventh.frames])
    expected = encoding.encode(flow.displacement(window)).values.astype(np.float16)
    np.testing.assert_array_equal(presses.features[6], expected)


def test_a_new_rest_image_has_a_new_name(presses: RecordedPresses) -> None:
    assert len(set(presses.reference_id[:6])) == len(set(presses.reference_id[6:])) == 1
    assert presses.reference_id[0] != presses.reference_id[11]
    assert presses.confidence_row.tolist() == [0] * 6 + [1] * 6


def test_each_image_can_be_a_sample_of_its_own(bag: Path) -> None:
    found = build([bag], dataclasses.replace(COARSE, frames='each'))
    assert len(found) == 12 * FRAMES
    assert (np.diff(found.stamp_ns[:FRAMES]) == FRAME_NS).all()
    assert np.unique(found.press_number, return_counts=True)[1].tolist() == [FRAMES] * 12


def test_the_first_image_alone_can_be_the_sample(bag: Path, presses: RecordedPresses) -> None:
    found = build([bag], dataclasses.replace(COARSE, frames='first'))
    assert (len(found), found.frames.tolist()) == (12, [1] * 12)
    assert not np.array_equal(found.features, presses.features)


def test_images_of_the_untouched_gel_make_their_share(bag: Path) -> None:
    """A fifth of all samples: three beside twelve presses."""
    found = build([bag], dataclasses.replace(COARSE, without_contact=0.2))
    untouched = ~found.contact
    assert untouched.sum() == 3
    assert (found.labels[untouched] == 0).all()
    assert (found.as_samples().presses[untouched, 2] < 0).all()
    assert (found.stamp_ns[untouched] < found.window_ns[np.flatnonzero(untouched) - 1, 0]).all()


def test_images_with_the_tip_in_the_gel_are_no_images_of_the_untouched_gel(collection: Collection) -> None:
    """A press cut short leaves images without a window; the rig's state tells them from those at rest."""
    collection.press(0, 1, 0.0, 0.0, 1.0)
    collection.images(collection.window_ns(1)[0], 2, 1.0)
    collection.press(2, 2, 3.0, 0.0, 1.0)
    with CollectionBag(collection.close()) as opened:
        second = list(opened.presses())[1]
        assert len(second.untouched) == 2
        assert 'images between windows with the tip in the gel: 2' in opened.problems


def pushed(z_n: float) -> types.Wrench:
    return types.Wrench(force=types.Vector3(z=z_n))


SPOILED: list[tuple[str, str, dict[str, Any]]] = [
    (exclusions.REJECTED, 'no steady force', {'status': types.Press.STATUS_REJECTED, 'reason': 'no steady force'}),
    (exclusions.NOT_SETTLED, 'changed by +0.5 N/s', {'force_rate': 0.5}),
    (exclusions.NOT_SETTLED, 'spread by 0.3 N', {'wrench_deviation': pushed(0.3)}),
    (exclusions.LOST_FRAMES, '2 images are in the bag, but 3 were taken', {'frames': 2}),
    (exclusions.LOST_FRAMES, '0 images are in the bag', {'frames': 0}),
    (exclusions.LIMITS, 'force of 0.9 N', {'wrench': pushed(-0.9)}),
    (exclusions.LIMITS, 'away from the gel', {'wrench': pushed(0.2)}),
    (exclusions.LIMITS, 'depth 0.9 mm instead of 1 mm', {'depth_reported': 0.9e-3}),
    (exclusions.OUTSIDE, '(20, 3) mm', {'position': types.Point(x=20e-3, y=3e-3)}),
    (exclusions.BAD_NUMBERS, 'is not a number', {'wrench': pushed(float('nan'))}),
    (exclusions.BAD_NUMBERS, 'a depth of 0 mm', {'depth': 0.0}),
    (exclusions.BAD_NUMBERS, 'ends before it begins', {'window_end': types.Time()}),
]


@pytest.mark.parametrize(('reason', 'detail', 'spoiled'), SPOILED, ids=[detail for _, detail, _ in SPOILED])
def test_a_press_that_cannot_be_used_is_left_out_and_listed(
    collection: Collection, reason: str, detail: str, spoiled: dict[str, Any]
) -> None:
    collection.press(0, 1, 0.0, 0.0, 0.5)
    collection.press(1, 2, 3.0, 3.0, 1.0, **spoiled)
    limits = dataclasses.replace(COARSE.limits, largest_force_n=0.8)
    found = build([collection.close()], dataclasses.replace(COARSE, limits=limits))
    assert found.press.tolist() == [1]
    assert left_out(found) == [(2, 1, reason)]
    assert detail in found.card['left_out'][0]['detail']


def test_noise_of_a_coarse_cell_is_not_taken_for_a_changing_force() -> None:
    """0.02 N of noise in 8 samples over 0.1 s make 0.02 * sqrt(12 / 8) / 0.1 = 0.245 N/s of slope at one sigma."""
    assert exclusions.rate_noise(0.0, 0.02, 8, 0.1) == pytest.approx(0.245, abs=1e-3)


def test_a_force_that_only_drifts_has_no_noise() -> None:
    """A straight ramp of 1 N/s over 0.1 s spreads by 0.1 / sqrt(12) N."""
    assert exclusions.rate_noise(1.0, 0.1 / 12**0.5 * 0.999, 1000, 0.1) == 0.0


def test_axes_that_a_sensor_does_not_measure_leave_nothing_out(collection: Collection) -> None:
    unknown = float('nan')
    wrench = types.Wrench(force=types.Vector3(x=unknown, y=unknown, z=-0.2), torque=types.Vector3(x=unknown))
    collection.press(0, 1, 0.0, 0.0, 0.5, wrench=wrench)
    assert build([collection.close()], COARSE).force_n.tolist() == [0.2]


def test_a_press_from_before_the_first_rest_image_is_left_out(tmp_path: Path, sensor: Sensor) -> None:
    collection = Collection(tmp_path / 'late', sensor)
    collection.press(0, 1, 0.0, 0.0, 0.5)
    collection.reference(1)
    collection.press(1, 2, 0.0, 0.0, 0.5)
    assert left_out(build([collection.close()], COARSE)) == [(1, 1, exclusions.NO_REFERENCE)]


def test_presses_that_a_recorder_took_in_before_their_images_are_kept(
    collection: Collection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stood still during three presses, and then took in one topic after the other."""
    write, late_ns = collection.writer.write, collection.start_ns + 60 * SECOND_NS
    order = {f'/{topic.name}': number for number, topic in enumerate((RIG_STATE, PRESS, PRESS_IMAGE))}

    def late(topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        write(topic, data, late_ns + order[topic], publish_ns)

    monkeypatch.setattr(collection.writer, 'write', late)
    for slot in range(3):
        collection.press(slot, slot + 1, 0.0, 0.0, 0.5)
    found = build([collection.close()], COARSE)
    assert left_out(found) == []
    assert found.press.tolist() == [1, 2, 3]


def test_a_press_with_a_black_image_is_left_out(collection: Collection, monkeypatch: pytest.MonkeyPatch) -> None:
    collection.press(0, 1, 0.0, 0.0, 0.5)
    with monkeypatch.context() as patch:
        patch.setattr(collection.sensor, 'image', lambda *_: np.zeros((440, 440), np.uint8))
        collection.press(1, 2, 0.0, 0.0, 0.5)
    found = build([collection.close()], COARSE)
    assert left_out(found) == [(2, 1, exclusions.BAD_IMAGE)]
    assert 'black' in found.card['left_out'][0]['detail']


def test_the_last_attempt_counts(collection: Collection) -> None:
    for attempt in (1, 2):
        collection.press(attempt - 1, 1, 0.0, 0.0, 0.5, attempt=attempt)
    found = build([collection.close()], COARSE)
    assert found.attempt.tolist() == [2]
    assert (found.quality & RETRIED).all()
    assert left_out(found) == [(1, 1, exclusions.SUPERSEDED)]


def test_an_attempt_that_cannot_be_used_takes_nothing_from_the_one_before(collection: Collection) -> None:
    collection.press(0, 1, 0.0, 0.0, 0.5)
    collection.press(1, 1, 0.0, 0.0, 0.5, attempt=2, frames=1)
    found = build([collection.close()], COARSE)
    assert found.attempt.tolist() == [1]
    assert left_out(found) == [(1, 2, exclusions.LOST_FRAMES)]


def test_a_press_that_became_suspect_later_does_not_count(collection: Collection) -> None:
    collection.press(0, 1, 0.0, 0.0, 0.5)
    message = collection.press(1, 2, 0.0, 0.0, 0.5)
    collection.again(dataclasses.replace(message, status=types.Press.STATUS_SUSPECT, reason='an axis sticks'), 2)
    found = build([collection.close()], COARSE)
    assert set(found.press.tolist()) == {1}
    assert left_out(found) == [(2, 1, exclusions.SUSPECT)]


def test_a_press_reported_twice_counts_once(collection: Collection) -> None:
    message = collection.press(0, 1, 0.0, 0.0, 0.5)
    collection.again(message, 0)
    assert left_out(build([collection.close()], COARSE)) == [(1, 1, exclusions.DOUBLED)]


def test_the_same_bag_twice_gives_each_press_once(bag: Path) -> None:
    found = build([bag, bag], COARSE)
    assert len(found) == 12
    assert {reason for _, _, reason in left_out(found)} == {exclusions.DOUBLED}


def resumed(tmp_path: Path, sensor: Sensor) -> list[Path]:
    """A collection cut short after its first press, and one that began again at that press."""
    bags = []
    sensor.begin_anew()
    for number, start_ns in enumerate((START_NS, START_NS + 3600 * SECOND_NS)):
        collection = Collection(tmp_path / f'part{number}', sensor, start_ns)
        collection.reference(0)
        collection.press(0, 1, 0.0, 0.0, 0.5, attempt=number + 1)
        bags.append(collection.close())
    return bags


@pytest.mark.parametrize('order', [1, -1])
def test_of_a_resumed_collection_the_later_attempt_counts_in_whatever_order_bags_are_given(
    tmp_path: Path, sensor: Sensor, order: int
) -> None:
    found = build(resumed(tmp_path, sensor)[::order], COARSE)
    assert found.attempt.tolist() == [2]
    assert left_out(found) == [(1, 1, exclusions.SUPERSEDED)]


def test_separate_runs_of_one_plan_are_all_kept(tmp_path: Path, sensor: Sensor) -> None:
    found = build(resumed(tmp_path, sensor), dataclasses.replace(COARSE, separate_runs=True))
    assert found.bag.tolist() == [0, 1]
    assert len(set(found.press_number)) == 2


def test_of_separate_runs_a_suspect_of_one_takes_nothing_from_the_other(tmp_path: Path, sensor: Sensor) -> None:
    bags = []
    for number, start_ns in enumerate((START_NS, START_NS + 3600 * SECOND_NS)):
        collection = Collection(tmp_path / f'run{number}', sensor, start_ns)
        collection.reference(0)
        message = collection.press(0, 1, 0.0, 0.0, 0.5)
        if number == 1:
            collection.press(1, 2, 0.0, 0.0, 0.5)
            collection.again(dataclasses.replace(message, status=types.Press.STATUS_SUSPECT, reason='it sticks'), 2)
        bags.append(collection.close())
    found = build(bags, dataclasses.replace(COARSE, separate_runs=True))
    assert list(zip(found.bag.tolist(), found.press.tolist(), strict=True)) == [(0, 1), (1, 2)]


def test_what_was_measured_is_not_measured_again(bag: Path, presses: RecordedPresses, monkeypatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError('measured again')

    monkeypatch.setattr('tactile_nodes.sensing.rest.prepared.PreparedRest.features', refuse)
    assert build([bag], COARSE).fingerprint == presses.fingerprint


def test_other_options_are_measured_anew(bag: Path, presses: RecordedPresses) -> None:
    found = build([bag], dataclasses.replace(COARSE, flow=Choice('dis', {'preset': 'medium'})))
    assert found.card['recipe'] != presses.card['recipe']
    assert not np.array_equal(found.features, presses.features)


def test_after_ctrl_c_the_next_run_goes_on_from_what_was_measured(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    with pytest.raises(KeyboardInterrupt):
        build([bag], COARSE, Told(ctrl_c_at=5))
    told = Told()
    build([bag], COARSE, told)
    assert told.steps[-1] == '14 measured, 10 known, 0 out'  # a press, and the gel before it


def test_a_damaged_cache_is_named(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    build([bag], COARSE)
    for file in tmp_path.rglob('*.sqlite'):
        file.write_bytes(b'no database at all' * 100)
    with pytest.raises(DatasetError, match='delete it, it will be made again'):
        build([bag], COARSE)


def test_a_bag_without_presses_is_refused(tmp_path: Path) -> None:
    BagWriter(tmp_path / 'empty').close()
    with pytest.raises(DatasetError, match='give a bag of a collection'):
        build([tmp_path / 'empty'], COARSE)


def test_a_bag_of_a_run_that_never_pressed_is_left_out(bag: Path, tmp_path: Path) -> None:
    BagWriter(tmp_path / 'empty').close()
    told = Told()
    assert build([tmp_path / 'empty', bag], COARSE, told).fingerprint == build([bag], COARSE).fingerprint
    assert any('left out' in line and str(tmp_path / 'empty') in line for line in told.lines)


def test_if_no_press_can_be_used_the_reasons_are_reported(collection: Collection) -> None:
    collection.press(0, 1, 0.0, 0.0, 0.5, frames=1)
    with pytest.raises(DatasetError, match=r'no press of .* can be used: 1 lost frames \(the first: 1 images'):
        build([collection.close()], COARSE)


def test_a_sensor_is_chosen_by_its_namespace(tmp_path: Path, sensor: Sensor) -> None:
    collection = Collection(tmp_path / 'two', sensor, namespace='/left')
    collection.reference(0)
    collection.press(0, 1, 0.0, 0.0, 0.5)
    folder = collection.close()
    assert len(build([folder], dataclasses.replace(COARSE, namespace='left'))) == 1
    with pytest.raises(DatasetError, match=r'holds no topic press .* in the namespace right'):
        build([folder], dataclasses.replace(COARSE, namespace='right'))


def test_presses_of_several_sensors_are_refused_saying_which_command_can_choose(tmp_path: Path, sensor: Sensor) -> None:
    """Also the node of a launch says this, and has no namespace that could be chosen."""
    collection = Collection(tmp_path / 'two', sensor, namespace='/left')
    collection.writer.add_topic(BagTopic.of_type('/right/press', PRESS.type_name))
    with pytest.raises(DatasetError, match=r'/left/press, /right/press; .*--namespace .*use tactile calibrate instead'):
        CollectionBag(collection.close())
