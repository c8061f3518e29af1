"""What pictures show of a sensor: patterns drawn by hand, and simulated from descriptions, are reported as they are."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.flow.dot_pattern import find_dots
from tactile_nodes.sensing.inspection.describing import Answers, describe, understood, usual_crop
from tactile_nodes.sensing.inspection.drawing import figure
from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK
from tactile_nodes.sensing.inspection.judging import Inspection, size_finding
from tactile_nodes.sensing.inspection.stillness import alike, apart_px
from tactile_nodes.sensing.inspection.texture import looks_covered, mark_px, noise_grey
from tactile_nodes.sensors import CameraDescription, ImageSettings, MaskSettings, Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics, Press

DOTS, MEMBRANE = load_sensor('printed_dots'), load_sensor('speckle_membrane')


def drawn(turn_deg: float = 0.0, *, dark: bool = True, blur_px: float = 1.0) -> np.ndarray:
    """Discs 20 px wide and 50 px apart, turned about the middle of 400x300 px, on grey that falls to the right."""
    paper, ink = (180.0, 40.0) if dark else (40.0, 180.0)
    y, x = np.mgrid[:300, :400].astype(float)
    turn = math.radians(turn_deg)
    along = (x - 200) * math.cos(turn) + (y - 150) * math.sin(turn)
    down = (y - 150) * math.cos(turn) - (x - 200) * math.sin(turn)
    off = [each - 50 * np.round(each / 50) for each in (along, down)]
    picture = np.where(np.hypot(*off) < 10, ink, paper) * (1 - x / 1000)
    return np.rint(cv2.GaussianBlur(picture, (0, 0), blur_px)).astype(np.uint8)


def speckle(mark: float = 1.5, seed: int = 1) -> np.ndarray:
    """Spots of light with this standard deviation, at random."""
    picture = np.zeros((300, 400), np.float32)
    random = np.random.default_rng(seed)
    picture[random.integers(0, 300, 4000), random.integers(0, 400, 4000)] = 1.0
    blurred = cv2.GaussianBlur(picture, (0, 0), mark) * 2 * math.pi * mark**2
    return np.clip(20 + 100 * blurred, 0, 255).astype(np.uint8)


@pytest.fixture(scope='module')
def membrane() -> np.ndarray:
    gel = replace(gel_of(MEMBRANE), mechanics='linear')
    return Optics(gel, linear_table(gel)).render((), 1)


@pytest.fixture(scope='module')
def optics() -> Optics:
    gel = replace(gel_of(DOTS), mechanics='linear')
    return Optics(gel, linear_table(gel))


@pytest.fixture(scope='module')
def printed(optics: Optics) -> list[np.ndarray]:
    return [optics.render((), number) for number in range(4)]


@pytest.mark.parametrize('dark', [True, False])
def test_dots_are_found_with_their_pitch_width_turn_and_blur(dark: bool) -> None:
    dots = find_dots(drawn(4.0, dark=dark, blur_px=2.0))
    assert dots is not None
    assert dots.dark is dark
    assert dots.pitch_px == pytest.approx(50, abs=0.3)
    assert dots.diameter_px == pytest.approx(20, abs=1.0)
    assert dots.turn_deg == pytest.approx(4.0, abs=0.3)
    assert dots.edge_px == pytest.approx(2.0, abs=0.3)
    assert np.hypot(*(dots.centres_px - [200, 150]).T).min() < 0.3


def test_a_few_small_dots_are_found_too() -> None:
    """12 of 10 px cover less than a hundredth of the picture."""
    picture = np.full((300, 400), 160, np.uint8)
    for x, y in np.stack(np.meshgrid(np.arange(50, 400, 100), np.arange(50, 300, 100)), -1).reshape(-1, 2).tolist():
        cv2.circle(picture, (x, y), 5, 40, -1, cv2.LINE_AA)
    dots = find_dots(picture)
    assert dots is not None
    assert len(dots) == 12
    assert dots.pitch_px == pytest.approx(100)


def test_spots_at_random_are_no_dots() -> None:
    assert find_dots(speckle()) is None
    assert find_dots(speckle(4.0)) is None


@pytest.mark.parametrize('mark', [1.5, 2.0, 2.5])
def test_the_width_of_spots_is_measured(mark: float) -> None:
    everywhere = np.ones((300, 400), bool)
    assert mark_px(speckle(mark), everywhere) == pytest.approx(mark, rel=0.2)


def test_noise_is_told_apart_from_a_pattern() -> None:
    noisy = speckle().astype(float) + np.random.default_rng(2).normal(0, 3, (300, 400))
    quiet = np.full((300, 400), 90.0) + np.random.default_rng(2).normal(0, 3, (300, 400))
    assert noise_grey(np.rint(quiet).astype(np.uint8)) == pytest.approx(3, rel=0.2)
    assert noise_grey(np.clip(noisy, 0, 255).astype(np.uint8)) < 8


@pytest.mark.parametrize('picture', [drawn(), speckle()], ids=['dots', 'speckle'])
def test_dark_strips_and_lights_look_covered(picture: np.ndarray) -> None:
    """A strip of 60 px and a light of 50x50 px; a pattern has none of its own."""
    assert not looks_covered(picture, find_dots(picture)).any()
    covered = np.zeros(picture.shape, bool)
    covered[:, :60] = covered[150:200, 200:250] = True
    picture = picture.copy()
    picture[:, :60], picture[150:200, 200:250] = 5, 255
    found = looks_covered(picture, find_dots(picture))
    assert (found & covered).sum() / covered.sum() > 0.9
    assert (found & ~covered).sum() / covered.sum() < 0.15


def test_pictures_of_the_described_sensor_are_ok(printed: list[np.ndarray], membrane: np.ndarray) -> None:
    for inspection in (
        Inspection(DOTS, {str(number): each for number, each in enumerate(printed)}),
        Inspection(MEMBRANE, {'membrane': membrane}),
    ):
        assert {each.level for each in inspection.findings} == {OK}
        assert figure(inspection).shape[1] >= 640
    found = {each.subject: each.text for each in Inspection(DOTS, {'a': printed[0], 'b': printed[1]}).findings}
    assert found['dots'] == '35 dark dots found, 35 described within the image'
    assert found['pitch'].startswith('43.2 px apart, 43.3 described')


def levels(sensor: Sensor, *pictures: np.ndarray) -> dict[str, str]:
    named = {str(number): each for number, each in enumerate(pictures)}
    return {each.subject: each.level for each in Inspection(sensor, named).findings}


def test_what_is_wrong_is_said(printed: list[np.ndarray], membrane: np.ndarray) -> None:
    aside = replace(DOTS, pattern=replace(DOTS.pattern, dot_mm=(0.7, -0.4)))
    blurred = cv2.GaussianBlur(printed[0], (0, 0), 4.0)
    assert levels(DOTS, blurred)['focus'] == LOOK
    assert levels(MEMBRANE, cv2.GaussianBlur(membrane, (0, 0), 3.0))['focus'] == LOOK
    assert levels(DOTS, np.full_like(printed[0], 90))['dots'] == BAD
    assert levels(DOTS, np.zeros_like(printed[0]))['light'] == BAD
    assert levels(DOTS, 255 - printed[0])['dots'] == BAD  # bright dots
    assert levels(replace(DOTS, pattern=replace(DOTS.pattern, pitch_mm=2.2)), printed[0])['pitch'] == LOOK
    assert levels(replace(DOTS, pattern=MEMBRANE.pattern), printed[0])['pattern'] == BAD
    assert levels(aside, printed[0])['place'] == LOOK
    assert levels(DOTS, printed[0], np.roll(printed[1], 2, axis=1))['noise'] == LOOK
    hidden = printed[0].copy()
    hidden[:, :80] = 2
    assert levels(DOTS, hidden)['mask'] == LOOK
    masked = replace(DOTS, mask=MaskSettings(('0,0 90,0 90,239 0,239',)))
    assert levels(masked, hidden)['mask'] == OK


def grid(across: tuple[float, float], down: tuple[float, float]) -> np.ndarray:
    """Dots of 20 px about the middle of 400x300 px, each such ways (px) from the next ones."""
    y, x = np.mgrid[:300, :400].astype(float)
    row, column = np.linalg.solve(np.array([across, down]).T, [x.ravel() - 200, y.ravel() - 150])
    off = [each - np.round(each) for each in (row, column)]
    away = np.hypot(*(np.array([across, down]).T @ off)).reshape(x.shape)
    return np.rint(cv2.GaussianBlur(np.where(away < 10, 40.0, 180.0), (0, 0), 1.0)).astype(np.uint8)


@pytest.mark.parametrize('sensor', [DOTS, MEMBRANE])
def test_a_black_picture_is_judged_by_its_light_alone(sensor: Sensor) -> None:
    found = Inspection(sensor, {'it': np.zeros((sensor.image.height, sensor.image.width), np.uint8)}).findings
    assert [each.subject for each in found] == ['size', 'frame', 'light']
    assert found[-1].level == BAD and 'switch on the light' in found[-1].text


def test_the_width_is_that_of_the_whole_picture_though_only_its_middle_is_used(membrane: np.ndarray) -> None:
    """640 px that are 25 mm of the surface, 20 mm away: a focal length of 512 px, however deep the pattern is."""
    middle = understood(np.ascontiguousarray(membrane[:, 80:560]))
    for markers_mm in ((0.2, 0.5), (1.5, 4.0)):
        sensor = describe(middle, Answers('mine', 25.0, markers_mm=markers_mm), (640, 480))
        assert sensor.camera.focal_px[0] == pytest.approx(512)


def test_a_part_without_dots_is_to_be_masked(printed: list[np.ndarray]) -> None:
    """Ten of 35 dots are missing, in the columns at the left and the right."""
    rest = printed[0].copy()
    rest[:, :60] = rest[:, -60:] = np.median(rest)
    (dots,) = (each for each in Inspection(DOTS, {'a': rest}).findings if each.subject == 'dots')
    assert dots.level == LOOK and '25 dark dots found, 35 described' in dots.text
    assert 'if a part has no dots, mask it, or forces are reported at the wrong places' in dots.text


def test_a_picture_is_described_with_as_many_markers_as_it_was_simulated_with(membrane: np.ndarray) -> None:
    """18.9 per mm², of which 10.4 are seen one by one."""
    sensor = describe(understood(membrane), Answers('mine', 25.0), (640, 480))
    per_mm2 = sensor.pattern.count / (sensor.gel.width_mm * sensor.gel.height_mm)
    assert per_mm2 == pytest.approx(9000 / (25 * 19), rel=0.2)
    (pattern,) = (each for each in Inspection(sensor, {'a': membrane}).findings if each.subject == 'pattern')
    found, expected = re.findall(r'([\d.]+)(?: per mm² found| expected)', pattern.text)
    assert float(found) == pytest.approx(float(expected), rel=0.05)


@pytest.mark.parametrize(
    ('across', 'down', 'fault'),
    [
        ((34.6, 20.0), (0.0, 40.0), 'staggered or in diagonal rows'),  # 60 degrees, all 40 px apart, turned by 90
        ((40.0, 0.0), (20.0, 40.0), 'staggered or in diagonal rows'),  # as far from row to row as along them
        ((35.4, 35.4), (-35.4, 35.4), 'staggered or in diagonal rows'),  # square, turned by 45
        ((38.6, 10.4), (10.4, 38.6), 'staggered or in diagonal rows'),  # 60 degrees, turned by 15
        ((40.0, 0.0), (12.0, 38.2), 'columns are 17 degrees off a right angle'),
        ((60.0, 0.0), (0.0, 40.0), '3.00 mm apart along rows and 2.00 mm along columns'),
    ],
)
def test_a_grid_that_no_description_holds_is_bad(
    across: tuple[float, float], down: tuple[float, float], fault: str
) -> None:
    """Of 400 px that are 20 mm of the pattern, and a little more of the surface above it: 20 px a millimetre."""
    picture = grid(across, down)
    answers = Answers('it', 20.0 * 20.0 / 19.65, markers_mm=(0.3, 0.4))
    sensor = describe(understood(picture), answers, (400, 300))
    (dots,) = (each for each in Inspection(sensor, {'it': picture}).findings if each.subject == 'dots')
    assert dots.level == BAD
    assert fault in dots.text
    assert 'supports rows and columns at right angles only' in dots.text
    random = replace(sensor, pattern=MEMBRANE.pattern)
    (dots,) = (each for each in Inspection(random, {'it': picture}).findings if each.subject == 'pattern')
    assert dots.level == BAD
    assert fault in dots.text and 'set pattern.kind' not in dots.text


@pytest.mark.parametrize('sideways', [1, 3])
def test_a_sensor_whose_camera_lies_on_its_side_is_as_good(printed: list[np.ndarray], sideways: int) -> None:
    """Rolled by 90 degrees, a camera sees above the middle what is right of it: the image is turned to the left."""
    camera = replace(DOTS.camera, roll_deg=90.0 * sideways, centre_px=(119.5, 159.5))
    image = replace(DOTS.image, width=240, height=320, crop=240, crop_height=320)
    picture = np.ascontiguousarray(np.rot90(printed[0], sideways))
    assert levels(replace(DOTS, image=image, camera=camera), picture) == levels(DOTS, printed[0])


def test_far_more_dots_than_described_are_bad(printed: list[np.ndarray]) -> None:
    """Twice the pitch is a quarter of the dots."""
    few = replace(DOTS, pattern=replace(DOTS.pattern, pitch_mm=2 * DOTS.pattern.pitch_mm))
    assert levels(few, printed[0])['dots'] == BAD


def test_a_gel_that_shows_hardly_any_marks_tells_no_force(membrane: np.ndarray) -> None:
    """Neither one without any, nor the rim alone of one in the midst of its housing."""
    height, width = membrane.shape
    plain = np.tile(np.linspace(60, 180, width).astype(np.uint8), (height, 1))
    most = MaskSettings((f'0,0 {0.85 * width:.0f},0 {0.85 * width:.0f},{height - 1} 0,{height - 1}',))
    for sensor, picture in ((MEMBRANE, plain), (replace(MEMBRANE, mask=most), membrane)):
        (regions,) = (each for each in Inspection(sensor, {'it': picture}).findings if each.subject == 'regions')
        assert regions.level == BAD
        assert 'too little to estimate forces: a gel without marks' in regions.text


def test_markers_that_are_not_those_described_are_reported(membrane: np.ndarray) -> None:
    """Seen of 25x19 mm 24.8 at the surface; from twice as far 50, of which 75 % lie beside the gel."""

    def levels_for(**camera: object) -> dict[str, str]:
        return levels(replace(MEMBRANE, camera=replace(MEMBRANE.camera, **camera)), membrane)

    dark = replace(MEMBRANE.pattern, dark=True)
    assert levels(replace(MEMBRANE, pattern=dark), membrane)['pattern'] == BAD
    assert levels(replace(MEMBRANE, pattern=dark), 255 - membrane)['pattern'] == OK
    assert levels(MEMBRANE, 255 - membrane)['pattern'] == BAD
    assert levels_for(position_mm=(0.0, 0.0, -40.0))['gel'] == BAD
    assert levels_for(position_mm=(0.0, 0.0, -25.0))['gel'] == LOOK
    near = levels_for(position_mm=(0.0, 0.0, -10.0))
    assert (near['pattern'], near['focus'], near['gel']) == (LOOK, LOOK, LOOK)
    few = replace(MEMBRANE, pattern=replace(MEMBRANE.pattern, count=900))
    assert levels(few, membrane)['pattern'] == LOOK


def test_how_much_of_the_gel_is_seen_is_reported(membrane: np.ndarray) -> None:
    """A lens of twice the focal length sees half of each side; a mask over the left half takes half of that."""
    tele = replace(MEMBRANE, camera=replace(MEMBRANE.camera, focal_px=(1024.0, 1024.0)))
    half = replace(tele, mask=MaskSettings(('0,0 319,0 319,479 0,479',)))
    for sensor, share in (
        (tele, 0.5 * 0.5 * 24.75 / 25 * 18.56 / 19),
        (half, 0.5 * 0.5 * 0.5 * 24.75 / 25 * 18.56 / 19),
    ):
        (gel,) = (each for each in Inspection(sensor, {'it': membrane}).findings if each.subject == 'gel')
        assert gel.level == LOOK
        assert int(gel.text.split(' %')[0]) == pytest.approx(100 * share, abs=2)
        assert 'of the described gel of 25 x 19 mm' in gel.text  # which shows a pitch or width in another unit


def test_noise_of_regions_is_their_motion_in_single_pictures(printed: list[np.ndarray]) -> None:
    moved = np.roll(printed[0], 1, axis=0)
    assert np.median(Inspection(DOTS, {'a': printed[0], 'b': moved}).noise_px) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize('untouched', [1, 3])
def test_pressed_pictures_among_untouched_ones_are_never_ok(
    optics: Optics, printed: list[np.ndarray], untouched: int
) -> None:
    """Also where they come first, are more, or one is there to compare with."""
    pressed = [optics.render((Press(3.0 * x, -2.0, 0.4),), 10 + x) for x in (-1, 0, 1, 2)]
    shown = {f'{number}.png': each for number, each in enumerate([*pressed[:untouched], *printed[:untouched]])}
    finding = Inspection(DOTS, shown).findings[-1]
    assert (finding.subject, finding.level) == ('noise', LOOK)
    assert 'something touches' in finding.text


def test_the_noise_is_that_of_the_pictures_that_are_alike(optics: Optics, printed: list[np.ndarray]) -> None:
    alone = Inspection(DOTS, {str(number): each for number, each in enumerate(printed)})
    pressed = {f'pressed{x}': optics.render((Press(3.0 * x, -2.0, 0.4),), 10 + x) for x in (-1, 0, 1)}
    mixed = Inspection(DOTS, {**dict(zip('abcd', printed, strict=True)), **pressed})
    assert np.median(mixed.noise_px) == pytest.approx(np.median(alone.noise_px), rel=0.3)
    assert '3 of 7 images, such as pressed-1, differ from the others' in mixed.findings[-1].text


def test_a_motion_of_one_region_counts_beyond_that_of_all_of_them() -> None:
    """1 px more in one of 81 regions: the fourth root of 1/81 is 1/3."""
    motion = np.full((2, 81, 2), [3.0, -1.0])
    motion[0] = 0.0
    motion[1, 40, 0] += 1.0
    np.testing.assert_allclose(apart_px(motion), [[0, 1 / 3], [1 / 3, 0]], atol=1e-12)


def test_a_picture_that_is_there_twice_makes_the_others_no_stranger() -> None:
    """All 0.03 px apart but two that are the same; with one 0.2 px away from all."""
    apart = np.full((6, 6), 0.03) * (1 - np.eye(6))
    apart[0, 1] = apart[1, 0] = 0.0
    apart[5, :5] = apart[:5, 5] = 0.2
    assert alike(apart)[1].tolist() == [True] * 5 + [False]


def test_a_picture_of_another_size_is_refused_by_its_name(membrane: np.ndarray) -> None:
    with pytest.raises(ConfigurationError, match=r'rest\.png has 640x480 pixels, but image .* says 320x240'):
        Inspection(DOTS, {'rest.png': membrane})


def test_a_description_made_of_a_picture_is_that_which_it_was_simulated_from(printed: list[np.ndarray]) -> None:
    """320 px are 18.82 mm, 20 mm from a lens of 340 px; 2.5 mm from dot to dot, of 1 mm."""
    seen = understood(printed[0])
    sensor = describe(seen, Answers('again', 18.82, markers_mm=(0.3, 0.4)), (320, 240))
    assert sensor.pattern.kind == 'dots'
    assert sensor.pattern.dark
    assert sensor.pattern.pitch_mm == pytest.approx(2.5, rel=0.02)
    assert sensor.pattern.diameter_mm[0] == pytest.approx(1.0, rel=0.08)
    assert sensor.camera.focal_px[0] == pytest.approx(340, rel=0.01)
    assert sensor.gel.width_mm == pytest.approx(18.82 * 1.05 * 19.7 / 20, abs=0.2)
    assert {each.level for each in Inspection(sensor, {'a': printed[0]}).findings} == {OK}


def test_dots_are_found_where_they_are_printed() -> None:
    """Half a millimetre right of the middle and one above it; those of the next row and column are as good."""
    there = replace(DOTS, pattern=replace(DOTS.pattern, dot_mm=(3.0, -1.0)))
    gel = replace(gel_of(there), mechanics='linear')
    rest = Optics(gel, linear_table(gel)).render((), 1)
    seen = Inspection(DOTS, {'a': rest}).findings
    assert [each.text for each in seen if each.subject == 'place'] == [
        'dots are 1.1 mm off the described positions, so forces are reported at the wrong places: set '
        'pattern.dot_mm to [0.5, -1.0]'
    ]
    again = describe(understood(rest), Answers('again', 18.82, markers_mm=(0.3, 0.4)), (320, 240))
    assert again.pattern.dot_mm == pytest.approx((0.5, -1.0), abs=0.05)


def test_simulated_dots_are_whole_in_large_pictures_too() -> None:
    camera = replace(DOTS.camera, focal_px=(1360.0, 1360.0), centre_px=(639.5, 479.5))
    large = replace(DOTS, image=replace(DOTS.image, width=1280, height=960, crop=1280, crop_height=960), camera=camera)
    gel = replace(gel_of(large), mechanics='linear')
    assert Inspection(large, {'a': Optics(gel, linear_table(gel)).render((), 1)}).usable


def test_a_calibrated_camera_and_the_width_say_how_far_away_it_is(membrane: np.ndarray) -> None:
    """25 mm of the surface fill 640 px, and 512 px are the focal length: 20 mm."""
    calibrated = Answers('membrane', 25.0, distance_mm=0.0, camera=MEMBRANE.camera)
    sensor = describe(understood(membrane), calibrated, (640, 480))
    assert sensor.camera.position_mm[2] == pytest.approx(-20, abs=0.01)
    with pytest.raises(ConfigurationError, match=r'the lens is 20.0 mm away, but 40 mm were given'):
        describe(understood(membrane), replace(calibrated, distance_mm=40.0), (640, 480))
    fisheye = CameraDescription('fisheye', focal_px_per_rad=320.0)
    round_about = describe(understood(membrane), replace(calibrated, camera=fisheye), (640, 480))
    assert round_about.camera.position_mm[2] == pytest.approx(-12.5 / math.tan(1), abs=0.01)
    # Of a lens of 640 px with k1 = -0.1, 320 px are a slope of s - 0.1 s³ = 0.5: s = 0.51354.
    bent = replace(MEMBRANE.camera, focal_px=(640.0, 640.0), distortion=(-0.1, 0.0, 0.0, 0.0, 0.0))
    barrel = describe(understood(membrane), replace(calibrated, camera=bent), (640, 480))
    assert barrel.camera.position_mm[2] == pytest.approx(-12.5 / 0.51354, abs=0.01)


def test_a_gel_whose_rim_is_seen_lies_where_it_is_seen(membrane: np.ndarray) -> None:
    """Only the left half shows gel: 12.3 of 24.6 mm, and 0.6 mm beyond the left rim; its middle is 6.5 mm left."""
    half = membrane.copy()
    half[:, 320:] = 3
    sensor = describe(understood(half), Answers('half', 24.6), (640, 480))
    assert sensor.gel.width_mm == pytest.approx(12.9, abs=0.6)
    assert sensor.camera.position_mm[0] == pytest.approx(6.5, abs=0.4)
    assert sensor.covered[:, 340:].all()
    # Three quarters: at the right 6.25 mm of the surface, but what is seen there lies 4 mm deep, 16 of 20 mm away.
    most = membrane.copy()
    most[:, 480:] = 3
    deep = describe(understood(most), Answers('deep', 25.0, markers_mm=(1.5, 4.0)), (640, 480))
    assert deep.gel.width_mm == pytest.approx(1.05 * 12.5 * 18.5 / 20 + 6.25 * 16 / 20, abs=0.5)


def test_answers_that_contradict_the_picture_are_refused(membrane: np.ndarray, printed: list[np.ndarray]) -> None:
    dots = understood(printed[0])
    with pytest.raises(ConfigurationError, match=r'means 17.6 px per mm, but the given pitch of 1 mm means 43\.'):
        describe(dots, Answers('x', 18.5, 1.0), (320, 240))
    with pytest.raises(ConfigurationError, match='a pitch was given, but the image shows no dots in rows and columns'):
        describe(understood(membrane), Answers('x', 25.0, 1.0), (640, 480))
    with pytest.raises(ConfigurationError, match=r'contradict each other: gel.markers_mm must hold two depths within'):
        describe(dots, Answers('x', 18.5, markers_mm=(1.5, 6.0)), (320, 240))
    with pytest.raises(ConfigurationError, match='the size of the gel in the image is unknown'):
        describe(dots, Answers('x'), (320, 240))
    with pytest.raises(ConfigurationError, match='shows no dots'):
        understood(membrane, 'dots')


def test_pictures_are_cut_to_sides_that_many_regions_divide() -> None:
    assert usual_crop(640, 480) == (640, 480)
    assert usual_crop(410, 308) == (400, 280)


@pytest.mark.parametrize(('width', 'height', 'level'), [(1280, 960, OK), (4000, 3000, LOOK), (3000, 4000, LOOK)])
def test_photographs_are_to_be_scaled_down(width: int, height: int, level: str) -> None:
    found = size_finding(ImageSettings(width, height, width, height), 3, dots=False)
    assert found.level == level
    assert found.text.startswith(f'3 images of {width}x{height}')
    assert ('scale all images down' in found.text) == (level == LOOK)
