"""The camera's twin, on a clock that only the tests move."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.camera.contract import CameraSettings, HasDrivenWorld, KnowsTruth, SceneSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.camera.simulated import build_scene
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory
from tactile_nodes.simulation import worlds
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.scene import WorldScene


def test_frames_are_stamped_at_the_instants_of_the_rate(jumping: SteppedClock) -> None:
    """At 60 frames a second the first three lie 0, 16 666 667 and 33 333 333 ns after the start."""
    start_ns = jumping.now_ns()
    camera = open_camera(CameraSettings(), jumping)
    assert [camera.read(1.0).stamp_ns - start_ns for _ in range(3)] == [0, 16_666_667, 33_333_333]
    assert jumping.now_ns() - start_ns == 33_333_333


def test_a_frame_shows_the_scene_at_its_stamp(jumping: SteppedClock) -> None:
    settings = CameraSettings(fps=2.0, scene=SceneSettings(start_ns=jumping.now_ns()))
    camera = open_camera(settings, jumping)
    scene = build_scene(settings.scene)
    for _ in range(3):
        frame = camera.read(1.0)
        assert (frame.image == scene.render(frame.stamp_ns)).all()


def test_a_late_reader_gets_the_newest_frame_and_the_lost_ones_are_counted(jumping: SteppedClock) -> None:
    """After 1 s of not reading at 60 a second, frame 60 is due; frames 1 to 59 are lost."""
    camera = open_camera(CameraSettings(), jumping)
    camera.read(1.0)
    jumping.advance(1.0)
    frame = camera.read(1.0)
    assert (frame.sequence, frame.dropped) == (60, 59)
    assert frame.stamp_ns == jumping.now_ns()


def test_the_camera_knows_the_truth_for_the_stamp_of_a_frame(jumping: SteppedClock) -> None:
    settings = CameraSettings(fps=4.0, scene=SceneSettings(start_ns=jumping.now_ns()))
    camera = open_camera(settings, jumping)
    assert isinstance(camera, KnowsTruth)
    scene = build_scene(settings.scene)
    stamps = [camera.read(1.0).stamp_ns for _ in range(8)]
    forces = [camera.truth(stamp_ns).total_n for stamp_ns in stamps]
    assert forces == [scene.truth(stamp_ns).total_n for stamp_ns in stamps]
    assert max(forces) > 0


def test_a_recording_knows_no_truth(folder: Path, jumping: SteppedClock) -> None:
    assert not isinstance(open_camera(CameraSettings(str(folder)), jumping), KnowsTruth)


def test_nothing_touches_the_gel_before_the_start_of_the_scene() -> None:
    start_ns = 10**18
    scene = build_scene(SceneSettings(start_ns=start_ns))
    assert not scene.truth(start_ns - 1).in_contact
    assert scene.truth(start_ns + 1_000_000_000).in_contact  # the middle of the first press of two seconds


def test_without_a_start_time_the_gel_rests_for_a_second_after_opening(jumping: SteppedClock) -> None:
    camera = open_camera(CameraSettings(), jumping)
    opened_ns = jumping.now_ns()
    touched = [camera.truth(opened_ns + tenth * 100_000_000).in_contact for tenth in range(30)]
    assert not any(touched[:11])
    assert any(touched[11:])


def test_a_slow_camera_shows_the_untouched_gel_for_as_many_frames_as_a_rest_image_takes(jumping: SteppedClock) -> None:
    """`tactile launch live` takes one of 16 frames; between presses at 10 frames a second come 15."""
    camera = open_camera(CameraSettings(fps=10.0), jumping)
    touched = [camera.truth(camera.read(1.0).stamp_ns).in_contact for _ in range(45)]
    assert not any(touched[:32])
    assert any(touched[32:])


def test_the_same_settings_show_the_same_world_and_another_gel_another() -> None:
    at_ns = 12_345
    assert (build_scene(SceneSettings()).render(at_ns) == build_scene(SceneSettings()).render(at_ns)).all()
    other = build_scene(SceneSettings(gel_seed=7)).render(at_ns)
    assert np.mean(other != build_scene(SceneSettings()).render(at_ns)) > 0.3


def test_a_gel_file_changes_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / 'gel.yaml'
    path.write_text('seed: 9\nmarker_count: 500\n', encoding='ascii')
    gel = build_scene(SceneSettings(gel=str(path))).gel
    assert (gel.seed, gel.marker_count, gel.size_mm) == (9, 500, 32.0)


def test_a_gel_file_with_an_unknown_property_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'gel.yaml'
    path.write_text('markers: 500\n', encoding='ascii')
    with pytest.raises(ConfigurationError, match=r'gel.yaml.*markers'):
        build_scene(SceneSettings(gel=str(path)))


def test_a_rate_of_zero_is_refused(jumping: SteppedClock) -> None:
    with pytest.raises(ConfigurationError, match='set fps'):
        open_camera(CameraSettings(fps=0.0), jumping)


def test_a_camera_of_a_shared_world_shows_the_gel_of_that_world_as_soon_as_it_is_there(jumping: SteppedClock) -> None:
    camera = open_camera(CameraSettings(scene=SceneSettings(world='of this test')), jumping)
    before = camera.read(1.0).image
    world = World(WorldSettings(start_mm=(-60.0, -60.0, -31.0)), Gel(seed=5))
    worlds.share('of this test', world)
    frame = camera.read(1.0)
    assert (frame.image == WorldScene(world).render(frame.stamp_ns)).all()
    assert np.mean(before != frame.image) > 0.3
    assert isinstance(camera, KnowsTruth)
    assert camera.truth(frame.stamp_ns).total_n == pytest.approx(world.force_at(frame.stamp_ns))


def test_a_camera_of_a_gel_that_is_known_starts_without_scipy() -> None:
    """Loading scipy takes as long as all the rest of the start, and a camera that ended has to be back soon."""
    code = (
        'import sys; from tactile_nodes.nodes import camera; from tactile_nodes.clock import SystemClock; '
        'source = camera.open_camera(camera.CameraParams(), SystemClock()); source.read(10.0); source.close(); '
        'sys.exit(any(name.partition(".")[0] == "scipy" for name in sys.modules))'
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0


def test_camera_of_what_is_held_shows_what_a_gripper_tells_and_knows_its_force(jumping: SteppedClock) -> None:
    camera = open_camera(CameraSettings(scene=SceneSettings(contact='held')), jumping)
    assert isinstance(camera, HasDrivenWorld)
    assert isinstance(camera, KnowsTruth)
    assert camera.driven_world is not None
    untouched = camera.read(1.0)
    camera.driven_world.put(untouched.stamp_ns + 1, Press(3.0, 0.0, 1.0, shift_mm=(0.1, 0.0)))
    pressed = camera.read(1.0)
    truth = camera.truth(pressed.stamp_ns)
    assert truth.position_mm == (3.0, 0.0)
    assert truth.total_n == pytest.approx(0.41, abs=0.01)  # docs/simulation.md: 1 mm deep
    assert truth.shear_n[0] > 0
    scene = WorldScene(camera.driven_world)
    assert (pressed.image == scene.render(pressed.stamp_ns)).all()
    assert np.mean(pressed.image != untouched.image) > 0.3


def test_a_gel_that_is_solved_first_is_reported_before(tmp_path: Path) -> None:
    """It takes half a minute, in which whoever waits may end it."""
    shipped = (share_directory() / 'config/sensors/printed_dots.yaml').read_text()
    (tmp_path / 'thick.yaml').write_text(shipped.replace('layers_mm: [4.0]', 'layers_mm: [4.321]'))

    def end(progress: str) -> None:
        raise InterruptedError(progress)

    with pytest.raises(InterruptedError, match='solving the gel deformation under the tip'):
        build_scene(SceneSettings(), end, str(tmp_path / 'thick.yaml'))


def test_the_gel_that_ships_is_there_at_once() -> None:
    told: list[str] = []
    build_scene(SceneSettings(), told.append)
    assert told == []
