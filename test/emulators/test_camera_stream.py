"""The emulated camera shows the world's gel as its gel file says: dents, exposure, one JPEG."""

from __future__ import annotations

import cv2
import numpy as np
from coarse_table import coarse_table

from tactile_nodes.clock import SteppedClock
from tactile_nodes.emulators.camera_stream import CameraStream
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.scene import WorldScene

S = 1_000_000_000


def pressed(gel: Gel) -> World:
    world = World(WorldSettings(start_mm=(-60.0, -60.0, -29.0)), gel, coarse_table())
    world.go((-60.0, -60.0, -31.5), 10.0, 0)
    return world


def shown(world: World, time_ns: int) -> np.ndarray:
    with CameraStream(world, SteppedClock(0)) as stream:
        data = stream.picture(time_ns)
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)


def test_the_picture_is_the_scene_of_the_world_through_one_jpeg() -> None:
    plain = pressed(Gel(jpeg_quality=50))
    assert (shown(plain, 5 * S) == WorldScene(plain).render(5 * S)).all()


def test_the_picture_of_a_moving_tip_is_blurred_by_the_exposure() -> None:
    moving_ns = S // 5
    sharp, blurred = (shown(pressed(Gel(exposure_s=exposure)), moving_ns).astype(float) for exposure in (0.0, 0.02))
    assert np.abs(blurred - sharp).max() > 4


def test_a_dent_is_seen_after_the_tip_has_left() -> None:
    worlds = [pressed(Gel(settling_share=share)) for share in (0.0, 0.3)]
    ups = [world.go((-60.0, -60.0, -28.0), 50.0, 4 * S) for world in worlds]
    plain, dented = (shown(world, up).astype(float) for world, up in zip(worlds, ups, strict=True))
    assert np.abs(dented - plain).max() > 20
