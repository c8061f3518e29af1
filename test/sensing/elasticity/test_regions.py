"""What regions see, against the layer by Hankel transform and a projection of points by hand."""

import dataclasses

import numpy as np
import pytest
from coarse_table import hertz, linear_table

from tactile_nodes.sensing.elasticity.rays import described_dots
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.elasticity.view import DEPTHS, View
from tactile_nodes.sensing.flow.dots import weights_of_dots
from tactile_nodes.sensing.geometry import FisheyeCamera
from tactile_nodes.sensors import BinSettings, CameraDescription, GelDescription, ImageSettings, Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.mechanics import Layer, contact_radius_mm
from tactile_nodes.simulation.optics import Optics, Press

FOCAL, PUPIL_MM = 290.0, 23.0


@pytest.fixture(scope='module')
def dark_dots() -> Sensor:
    """Printed 2.5 mm apart, none of them in the middle."""
    sensor = load_sensor('printed_dots')
    return dataclasses.replace(sensor, pattern=dataclasses.replace(sensor.pattern, dot_mm=(0.4, -1.1)))


@pytest.fixture(scope='module')
def regions() -> Regions:
    return Regions(Sensor(), 20, 20)


def test_a_press_moves_a_region_as_points_along_its_ray_move(regions: Regions) -> None:
    """1 N of Hertz's pressure over 0.8 mm at (3, 0) mm, seen by a region above and right of it, depth by depth."""
    known, place = np.array([9 * 20 + 13]), np.array([[3.0, 0.0]])
    terms = regions.terms_of_pressure(place, hertz(regions.layer, 0.8), known)[0, 0].reshape(2, DEPTHS, 3)[:, :, 0]
    pixel = np.array([[100 + 22 * 13 + 10.5, 20 + 22 * 9 + 10.5]])
    camera, layer = FisheyeCamera(640, 480, FOCAL), Layer(6.0, 0.111, 0.5)
    ray = camera.unproject(pixel)[0]
    for depth, at_mm in enumerate(regions.view.depths_mm.tolist()):
        point = np.array([0, 0, -PUPIL_MM]) + ray * (PUPIL_MM - at_mm) / ray[2]
        away = point[:2] - place[0]
        distance = float(np.hypot(*away))
        outward, upward = (
            float(each[0, 0]) for each in layer.displacement_mm(0.8, np.array([distance]), np.array([-at_mm]))
        )
        moved = np.array([*away / distance * outward, upward])
        start = point + np.array([0, 0, PUPIL_MM])
        projected = camera.project(np.stack([start + moved * 1e-3, start]))
        by_hand = 1e3 * (projected[0] - projected[1])
        assert terms[:, depth] == pytest.approx(by_hand, rel=0.06, abs=0.02), at_mm


def test_a_single_bin_has_a_surface_that_shear_moves() -> None:
    """Its patches are as wide as half the gel, so that the second one to either side is the same, a period apart."""
    one_bin = dataclasses.replace(Sensor(), bins=BinSettings(rows=1, cols=1))
    along_x, along_y = Regions(one_bin, 20, 20).surface_under_shear
    assert along_x[:, 0] == pytest.approx(along_x[:, -1], abs=1e-6)
    assert along_y[0] == pytest.approx(along_y[-1], abs=1e-6)
    assert along_x[2, 2] == along_x.max()
    assert along_y[2, 2] == along_y.max()


def test_a_patch_is_felt_as_a_ball_of_its_size_at_its_place(regions: Regions) -> None:
    """From some distance they are alike (Saint-Venant)."""
    known = np.arange(0, 400, 37)
    patch = 9 * 18 + 6
    place = regions.patches.centres_mm[patch : patch + 1]
    ball = regions.terms_of_pressure(place, hertz(regions.layer, 1.0), known)[0]
    square = regions.terms_of_patches(known)[..., patch]
    assert ball[:, :, ::3] == pytest.approx(square[:, :, ::3], abs=0.05 * float(np.abs(square[:, :, ::3]).max()))


def test_under_a_pinhole_the_middle_goes_by_focal_length_over_distance() -> None:
    """500 px and 20 mm: a patch of the middle that is pushed aside by 1 mm goes by 25 px at the surface."""
    image = ImageSettings(320, 240, 320, 240)
    camera = CameraDescription('pinhole', 290.0, (500.0, 500.0), (0.0,) * 5, (159.5, 119.5), (0.0, 0.0, -20.0))
    gel = GelDescription(12.0, 9.0, (4.0,), (0.1,), (0.5,), (0.0, 0.1))
    regions = Regions(Sensor('small', image, camera, gel), 9, 12)
    points, pixels_per_mm = regions.rays.points_mm[..., :2], regions.rays.px_per_mm
    middle = 4 * 12 + 6  # right of the middle by half a region: 13.3 px, which are 0.53 mm
    assert points[0, middle].mean(axis=0) == pytest.approx([13.333 / 25, 0.0], abs=0.01)
    assert pixels_per_mm[0, middle].mean(axis=0)[:, :2] == pytest.approx(25 * np.eye(2), rel=0.01)


def test_regions_that_see_beside_the_gel_are_known_as_such() -> None:
    """1.32 mm of the layer a region: 8 of 10 fit into 11.4 mm, 6 of 10 into 8 mm."""
    camera = CameraDescription('pinhole', 290.0, (333.3, 333.3), (0.0,) * 5, (219.5, 219.5), (0.0, 0.0, -10.0))
    gel = GelDescription(11.4, 8.0, (4.0,), (0.1,), (0.5,), (0.0, 0.01))
    sensor = Sensor('beside', ImageSettings(440, 440, 440), camera, gel)
    assert Regions(sensor, 10, 10).within_gel.sum() == 8 * 6


def test_a_region_at_the_rim_moves_as_what_it_sees_within_the_gel() -> None:
    """Its rays end 6.47, 5.94 and 5.41 mm from the middle, the gel 5.7 mm: as narrow regions 5.5 mm from the middle."""
    camera = CameraDescription('pinhole', 290.0, (333.3, 333.3), (0.0,) * 5, (219.5, 219.5), (0.0, 0.0, -10.0))
    moved = []
    for width_mm, count, known in ((11.4, 10, [40]), (20.0, 30, [362, 392, 422])):
        gel = GelDescription(width_mm, 8.0, (4.0,), (0.1,), (0.5,), (0.3, 0.31))
        regions = Regions(Sensor('rim', ImageSettings(440, 440, 440), camera, gel), count, count)
        terms = regions.terms_of_pressure(np.array([[-4.0, -0.66]]), hertz(regions.layer, 0.8), np.array(known))
        moved.append(float(terms[0, :, 0, ::3].sum(axis=-1).mean()))
    assert moved[0] == pytest.approx(moved[1], rel=0.1)


def test_speckle_is_near_the_surface_and_the_markers_of_the_papers_gel_are_not(regions: Regions):
    """In the middle these lie 3.75 mm deep in a gel of 6 mm, and speckle 0.35 mm deep in 4 mm."""
    assert not regions.near
    assert Regions(load_sensor('speckle_membrane'), 1, 1).near


def test_a_region_of_printed_dots_moves_as_its_dots_do(dark_dots: Sensor) -> None:
    """0.14 N of the tip at (1.6, -0.9), between four dots, as theory moves what each dot is filled with."""
    gel = dataclasses.replace(gel_of(dark_dots), mechanics='linear')
    table = linear_table(gel)
    optics, regions = Optics(gel, table), Regions(dark_dots, 6, 8)
    at_rest, moved = optics.project(()), optics.project((Press(1.6, -0.9, 0.5),))
    dots_px, pitch_px = described_dots(regions.view), 2.5 * regions.view.px_per_mm
    motion = [(moved - at_rest)[np.hypot(*(at_rest - dot).T) < pitch_px / 3].mean(axis=0) for dot in dots_px]
    expected = weights_of_dots(dots_px, pitch_px, (320, 240), (6, 8)) @ np.array(motion)
    terms = regions.terms_of_pressure(
        np.array([[1.6, -0.9]]), hertz(regions.layer, contact_radius_mm(0.5, gel.tip_radius_mm)), np.arange(48)
    )
    predicted = table.force_at(0.5) * terms[0] @ regions.nominal_shares
    assert np.abs(expected).max() > 0.2
    assert predicted == pytest.approx(expected, abs=0.03 * float(np.abs(expected).max()))


def test_dots_far_outside_the_view_are_not_in_the_picture_though_the_lens_distortion_puts_them_there() -> None:
    """r (1 - 0.3 r²) is 0.44 at 0.49 times the distance, which is in the picture, and again at 1.5 times."""
    sensor = load_sensor('printed_dots')
    camera = dataclasses.replace(sensor.camera, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    gel = dataclasses.replace(sensor.gel, width_mm=60.0, height_mm=46.0)
    view = View(dataclasses.replace(sensor, camera=camera, gel=gel))
    dots = described_dots(view)
    in_pitches = view.met_at(dots, view.middle_mm)[:, :2] / sensor.pattern.pitch_mm
    assert np.abs(in_pitches - np.rint(in_pitches)).max() < 1e-3
    assert len({*map(tuple, np.rint(in_pitches).tolist())}) == len(dots)


def test_nominal_shares_count_depths_once_and_slopes_not_at_all(regions: Regions) -> None:
    shares = regions.nominal_shares.reshape(DEPTHS, 3)
    assert shares[:, 0].sum() == pytest.approx(1.0)
    assert not shares[:, 1:].any()
    assert (np.diff(shares[:, 0]) > 0).all()  # what lies deeper is nearer to the camera


def test_a_rolled_camera_sees_a_press_turned_back() -> None:
    """By a quarter, about the middle, so that regions of a square picture take each other's places."""
    straight, rolled = Regions(Sensor(), 8, 8), Regions(Sensor(camera=CameraDescription(roll_deg=90.0)), 8, 8)
    everywhere, place, ball = np.arange(64), np.array([[4.0, 0.0]]), hertz(straight.layer, 0.8)
    plain = straight.terms_of_pressure(place, ball, everywhere)[0, :, :, ::3].reshape(8, 8, 2, DEPTHS)
    # What is right of the middle (x > 0) it sees above it (v < 0).
    turned = rolled.terms_of_pressure(place, ball, everywhere)[0, :, :, ::3].reshape(8, 8, 2, DEPTHS)
    back = np.stack([-turned[..., 1, :], turned[..., 0, :]], axis=2)
    assert np.rot90(back, -1) == pytest.approx(plain, abs=1e-3)


@pytest.mark.parametrize('roll_deg', [30.0, 90.0, -90.0, 180.0])
def test_the_scale_of_an_image_does_not_depend_on_the_roll_of_its_camera(roll_deg: float) -> None:
    """600 px over 22.5 mm, from the pupil to the middle of the markers: 26.67 px per mm."""
    camera = CameraDescription('pinhole', position_mm=(0.0, 0.0, -25.0), roll_deg=roll_deg)
    gel = GelDescription(layers_mm=(6.0,), moduli_mpa=(0.1,), poisson_ratios=(0.5,), markers_mm=(2.0, 3.0))
    assert View(Sensor(camera=camera, gel=gel)).px_per_mm == pytest.approx(600 / 22.5, rel=1e-6)


def test_a_pressure_aside_of_its_place_is_that_pressure_there(regions: Regions) -> None:
    known, aside = np.arange(0, 400, 7), np.array([[1.5, -2.25]])
    at_aside = regions.layer.points(aside, np.ones(1))
    there = regions.layer.points(np.zeros((1, 2)), np.ones(1))
    about = regions.terms_of_pressure(np.array([[2.0, 3.0]]), at_aside, known)[..., ::3]
    straight = regions.terms_of_pressure(np.array([[3.5, 0.75]]), there, known)[..., ::3]
    assert about == pytest.approx(straight, abs=0.03 * float(np.abs(straight).max()))
