"""What the page shows, from messages and times given by hand."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest
from seen import CELLS, MS, NAN, diagnostics, force, received, ring, taken_apart

from tactile_nodes import conversions
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.viewing.reasons import sentences
from tactile_nodes.web import picture
from tactile_nodes.web.recording import Recording
from tactile_nodes.web.scene import Scene

GREY = 100


def image(stamp_ms: float, grey: int = GREY, side: int = 40) -> Any:
    return conversions.image_message(np.full((side, side), grey, np.uint8), conversions.header(stamp_ms * MS, 'camera'))


def motion(stamp_ms: float, encoding: str, values: list[float]) -> types.FlowFeatures:
    return types.FlowFeatures(
        header=conversions.header(stamp_ms * MS, 'camera'), rows=1, cols=1, channels=2, encoding=encoding,
        values=np.array(values, np.float32), confidence=np.ones(1, np.float32), image_width=40, image_height=40,
    )  # fmt: skip


def seen(scene: Scene, now_ms: float) -> tuple[dict[str, Any], dict[str, bytes], list[tuple[float, float, float]]]:
    made = scene.packet(round(now_ms * MS))
    return taken_apart(made.body + made.samples)


def grey_of(jpeg: bytes) -> float:
    return float(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE).mean())


def test_picture_and_force_of_one_instant_are_shown_together() -> None:
    scene = Scene()
    for number, grey in enumerate((50, 100, 150)):
        scene.add_image(received(image(10 + number, grey), sequence=number + 1))
    scene.add_force(received(force(11, (0, 0.5, 0, 0)), 15))
    fields, sections, _ = seen(scene, 16)
    assert fields['force']['total_n'] == pytest.approx(0.5)
    assert fields['image']['stamp_s'] == pytest.approx(0.011)
    assert grey_of(sections['image']) == pytest.approx(100, abs=2)


def test_without_forces_the_newest_picture_is_shown() -> None:
    scene = Scene()
    scene.add_force(received(force(10), 10))
    for number, grey in enumerate((50, 150)):
        scene.add_image(received(image(10 + 700 * number, grey), sequence=number + 1))
    fields, sections, _ = seen(scene, 720)
    assert fields['age_s'] == pytest.approx(0.710)
    assert grey_of(sections['image']) == pytest.approx(150, abs=2)


def test_bins_travel_in_newtons_row_by_row() -> None:
    scene = Scene()
    scene.add_force(received(force(10, (0.125, 0.25, 0.5, -1.0)), 10))
    fields, sections, _ = seen(scene, 11)
    assert np.frombuffer(sections['bins'], '<f4').tolist() == [0.125, 0.25, 0.5, -1.0]
    assert (fields['force']['rows'], fields['force']['cols']) == (2, 2)


def test_contacts_travel_in_millimetres_with_what_is_known_of_them() -> None:
    scene = Scene()
    place = types.Point(x=0.004, y=-0.002, z=0.0)
    contact = types.Contact(position=place, position_sigma=0.0001, force=0.73, force_sigma=NAN)
    scene.add_force(received(force(10, (0.73, 0, 0, 0), (4.0, -2.0), contacts=[contact]), 10))
    fields, _, _ = seen(scene, 11)
    (found,) = fields['force']['contacts']
    assert (found['x_mm'], found['y_mm'], found['sigma_mm']) == pytest.approx((4.0, -2.0, 0.1))
    assert found['sigma_n'] is None


def of_ring() -> Scene:
    """A force and its field, of 10 ms, have come."""
    scene = Scene()
    for message, take in zip(ring(10 * MS), (scene.add_force, scene.add_field), strict=True):
        take(received(message, 11))
    return scene


def test_a_field_travels_in_kilopascals_beside_the_force_of_its_stamp() -> None:
    fields, sections, _ = seen(of_ring(), 12)
    assert (fields['surface']['rows'], fields['surface']['cols']) == (CELLS, CELLS)
    assert fields['surface']['cell_mm'] + fields['surface']['origin_mm'] == pytest.approx([1.0, 1.0, -18.0, -18.0])
    pressure, along_x, _, outline = np.frombuffer(sections['surface'], '<f4').reshape(-1, 4).T
    assert pressure.sum() * 1e-3 == pytest.approx(2.0, rel=1e-5)  # cells of 1 mm²
    assert along_x.sum() * 1e-3 == pytest.approx(0.6, rel=1e-4)
    assert outline.max() == pytest.approx(2.0)


def test_net_shear_torsion_and_explanation_travel_and_what_is_not_known_is_null() -> None:
    scene = Scene()
    scene.add_force(received(ring(10 * MS)[0], 11))
    net = seen(scene, 12)[0]['force']['net']
    assert net['explanation'] == 'field'
    assert (net['shear_n'], net['torsion_n_mm']) == pytest.approx((0.6, 4.0))
    fields = conversions.force_fields(np.ones((9, 9), np.float32), BinGrid(9, 9, 36.0, 36.0))
    scene.add_force(received(types.ForceDistribution(header=conversions.header(20 * MS, ''), **fields), 21))
    assert seen(scene, 22)[0]['force']['net']['shear_n'] is None


def test_a_force_waits_a_moment_for_its_field_so_that_the_picture_does_not_flicker() -> None:
    scene = of_ring()
    scene.add_force(received(ring(26 * MS)[0], 27))
    fields, sections, _ = seen(scene, 28)
    assert fields['force']['stamp_s'] == pytest.approx(0.010)
    assert sections['surface']
    scene.add_field(received(ring(26 * MS)[1], 28))
    assert seen(scene, 29)[0]['force']['stamp_s'] == pytest.approx(0.026)


def test_a_force_is_shown_without_a_field_when_none_comes_any_more() -> None:
    scene = of_ring()
    scene.add_force(received(ring(120 * MS)[0], 121))
    fields, sections, _ = seen(scene, 122)
    assert fields['force']['stamp_s'] == pytest.approx(0.120)
    assert (fields['surface'], sections['surface']) == (None, b'')


def test_an_invalid_force_waits_for_nothing() -> None:
    scene = of_ring()
    scene.add_force(received(ring(26 * MS, types.ForceDistribution.STATUS_INVALID)[0], 27))
    assert seen(scene, 28)[0]['force']['status'] == 'invalid'


def test_status_comes_with_its_reason_in_a_sentence() -> None:
    scene = Scene()
    kind = types.ForceDistribution
    dark = force(10, status=kind.STATUS_INVALID, reasons=kind.REASON_DARK_IMAGE)
    scene.add_force(received(dark, 10))
    fields, _, samples = seen(scene, 11)
    assert fields['force']['status'] == 'invalid'
    assert fields['force']['reasons'] == ['The image is dark. Is the lamp on and the lens uncovered?']
    assert math.isnan(samples[0][1])  # an invalid number is not drawn as a force


def test_the_course_holds_each_force_once_beside_the_truth_of_its_stamp() -> None:
    scene = Scene()
    scene.add_truth(received(force(1000, (0, 0.75, 0, 0)), 1001))
    for number in range(2):
        scene.add_force(received(force(1000 + 16 * number, (0, 0.5, 0, 0)), 1005 + 16 * number, number + 1))
    _, _, samples = seen(scene, 1030)
    assert samples == [(1.0, 0.5, 0.75), (1.016, 0.5, pytest.approx(NAN, nan_ok=True))]
    assert seen(scene, 1040)[2] == []


def test_a_picture_is_encoded_once_however_often_it_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[object] = []
    monkeypatch.setattr(picture, 'jpeg', lambda message: made.append(message) or b'jpeg')
    scene = Scene()
    scene.add_image(received(image(10), 10))
    for now_ms in (11, 12, 13):
        assert seen(scene, now_ms)[1]['image'] == b'jpeg'
    assert len(made) == 1


def test_nothing_new_is_reported_twice_a_second_only() -> None:
    scene = Scene()
    scene.add_force(received(force(10), 10))
    assert scene.is_due(11 * MS)
    seen(scene, 1000)
    assert not scene.is_due(1400 * MS)
    assert scene.is_due(1600 * MS)


def test_a_picture_of_before_somebody_looked_away_is_not_shown_again() -> None:
    scene = Scene()
    scene.add_image(received(image(10), 10))
    scene.look_again()
    fields, sections, _ = seen(scene, 6001)
    assert (fields['image'], sections['image']) == (None, b'')


def test_a_fresh_touch_is_known_and_an_old_one_is_not() -> None:
    scene = Scene()
    assert scene.touching_n(0) is None
    scene.add_force(received(force(10, (0, 0.5, 0, 0), (1.0, 1.0)), 10))
    assert scene.touching_n(20 * MS) == pytest.approx(0.5)
    assert scene.touching_n(5000 * MS) is None


@pytest.mark.parametrize(
    ('encoding', 'values'), [('cartesian_mean', [3.0, 4.0]), ('polar_mean', [5.0, math.atan2(4, 3)])]
)
def test_arrows_are_the_motion_in_pixels_whatever_the_encoding(encoding: str, values: list[float]) -> None:
    found = picture.arrows(motion(10, encoding, values))
    assert found is not None
    assert found.reshape(-1).tolist() == pytest.approx([3.0, 4.0, 1.0])


def test_an_encoding_that_is_no_motion_has_no_arrows() -> None:
    assert picture.arrows(motion(10, 'something_else', [3.0, 4.0])) is None


def test_large_pictures_are_made_smaller() -> None:
    found = picture.jpeg(image(10, side=2 * picture.LARGEST_PX))
    shape = cv2.imdecode(np.frombuffer(found, np.uint8), cv2.IMREAD_GRAYSCALE).shape
    assert shape == (picture.LARGEST_PX, picture.LARGEST_PX)


def test_a_picture_that_cannot_be_shown_is_named() -> None:
    scene = Scene()
    broken = types.Image(header=conversions.header(10 * MS, ''), height=2, width=2, step=2, encoding='bayer')
    scene.add_image(received(broken, 10))
    _, sections, _ = seen(scene, 1000)
    assert sections['image'] == b''
    assert 'bayer' in scene.view.snapshot(0).logs[0]


def recorder(name: str, text: str, **values: str) -> types.DiagnosticArray:
    pairs = [types.KeyValue(key=key, value=value) for key, value in values.items()]
    return types.DiagnosticArray(status=[types.DiagnosticStatus(name=name, level=0, message=text, values=pairs)])


def test_recording_is_what_the_recorder_says_of_itself() -> None:
    found = Recording('/left')
    assert found.summary(0) is None
    found.add_diagnostics(received(recorder('left/recorder: bag', 'nothing is being recorded')))
    assert (found.summary(0) or {})['on'] is False
    busy = recorder(
        'left/recorder: bag', 'into x', seconds='2.5', messages='300', lost='3', lost_of='/image_raw 3', bag='/x'
    )
    found.add_diagnostics(received(busy))
    found.add_diagnostics(received(recorder('right/recorder: bag', 'another')))
    assert found.summary(0) == {'on': True, 'seconds': 2.5, 'lost': 3, 'bag': '/x', 'well': True, 'text': 'into x'}
    found.add_diagnostics(received(recorder('left/recorder: bag', 'wrote it into /x', messages='300', bag='/x')))
    ended = found.summary(0) or {}
    assert (ended['on'], ended['bag'], ended['text']) == (False, '/x', 'wrote it into /x')


def test_a_recorder_that_ended_no_longer_records() -> None:
    """Ctrl-C or a kill ends it without a last report; nodes report once a second."""
    scene = Scene()
    busy = recorder('recorder: bag', 'recording into /x', seconds='2.5', messages='300', bag='/x')
    scene.add_diagnostics(received(busy, 1000))
    assert seen(scene, 4000)[0]['slow']['recording']['on'] is True
    recording = seen(scene, 6000)[0]['slow']['recording']
    assert (recording['on'], recording['well']) == (False, False)
    assert recording['text'] == 'no message from the recorder for 5 s: it has ended or hangs; its bag is /x'
    scene.add_diagnostics(received(recorder('recorder: bag', 'wrote 300 messages into /x', bag='/x'), 7000))
    recording = seen(scene, 60_000)[0]['slow']['recording']
    assert (recording['well'], recording['text']) == (True, 'wrote 300 messages into /x')  # what ended well stays said


def test_the_words_of_nodes_reach_the_page() -> None:
    scene = Scene()
    scene.add_diagnostics(received(diagnostics(('camera: camera', 1, 'dark')), 900))
    fields, _, _ = seen(scene, 1000)
    (found,) = fields['slow']['health']
    assert (found['node'], found['level'], found['text'], found['silent_s']) == (
        '/camera', 'warning', 'camera: dark', None,
    )  # fmt: skip


def test_whether_the_calibration_still_holds_is_reported_in_the_words_of_who_judges() -> None:
    scene = Scene()
    assert seen(scene, 1000)[0]['slow']['calibration'] is None
    kind = types.CalibrationState
    for number, (level, name) in enumerate(
        ((kind.LEVEL_AGEING, 'ageing'), (kind.LEVEL_UNCALIBRATED, 'not calibrated'))
    ):
        scene.add_calibration(received(kind(level=level, text='the lamp is dim')))
        calibration = seen(scene, 2000 + 1000 * number)[0]['slow']['calibration']
        assert calibration == {'level': name, 'text': 'the lamp is dim'}


def test_every_reason_has_a_sentence() -> None:
    kind = types.ForceDistribution
    bits = [bit for name, bit in vars(kind).items() if name.startswith('REASON_')]
    texts = sentences(sum(bits))
    assert len(texts) == len(bits)
    assert all(text[0].isupper() and text[-1] in '.?' and ' ' in text for text in texts)
