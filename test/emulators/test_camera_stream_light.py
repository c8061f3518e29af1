"""The light in the corner of the emulated camera's picture, and what a camera's driver makes of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.drivers.sync_input.camera_light import CameraLight, LightSettings
from tactile_nodes.emulators.camera_stream import EXPOSURE_S, LIGHT, CameraStream
from tactile_nodes.emulators.world import World
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.simulation.gel import Gel

START_NS = 100 * NS_PER_S
X, Y, WIDTH, HEIGHT = LIGHT
FPS = 60


@pytest.fixture(scope='module')
def world() -> World:
    """A line that rises at 100.2 s and falls at 100.5 s."""
    made = World(table=linear_table(Gel()))
    made.set_line(True, START_NS + 200_000_000)
    made.set_line(False, START_NS + 500_000_000)
    return made


@pytest.fixture(scope='module')
def stream(world: World) -> CameraStream:
    made = CameraStream(world, SystemClock())
    made._server.server_close()
    return made


def picture(stream: CameraStream, time_ns: int) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(stream.picture(time_ns), np.uint8), cv2.IMREAD_GRAYSCALE)


def test_the_light_is_bright_while_the_line_is_high_and_off_what_is_cut_out(stream: CameraStream) -> None:
    dark, lit = picture(stream, START_NS), picture(stream, START_NS + 300_000_000)
    assert lit[Y : Y + HEIGHT, X : X + WIDTH].mean() > 200
    assert dark[Y : Y + HEIGHT, X : X + WIDTH].mean() < 100
    crop = Crop.centred(dark.shape[1], dark.shape[0])
    assert crop.x > X + WIDTH + 8  # JPEG's blocks are 8 px wide


def test_edges_are_found_to_what_they_say_of_themselves(stream: CameraStream, world: World) -> None:
    """The picture of a time shows the exposure around it, which began half an exposure before."""
    lead_ms = EXPOSURE_S / 2 * 1000
    light = CameraLight(LightSettings(X, Y, WIDTH, HEIGHT, lead_ms=lead_ms), EXPOSURE_S * 1000)
    found = []
    for number in range(FPS):
        time_ns = START_NS + number * NS_PER_S // FPS
        edges = light.take(picture(stream, time_ns), time_ns)
        found += list(zip(edges.stamp_ns.tolist(), edges.level.tolist(), edges.uncertainty_s.tolist(), strict=True))
    assert [level for _, level, _ in found] == [True, False]
    assert light.edges == 2
    for (stamp_ns, _, half_s), edge in zip(found, world.line_edges(), strict=True):
        assert abs(stamp_ns - edge.stamp_ns) <= half_s * NS_PER_S + 1_000_000


def test_without_a_region_no_light_is_watched() -> None:
    assert not CameraLight(LightSettings(), 8.0).watched


def test_a_region_outside_the_picture_is_dark(stream: CameraStream) -> None:
    light = CameraLight(LightSettings(5000, 5000, 10, 10), 8.0)
    assert len(light.take(picture(stream, START_NS), START_NS).stamp_ns) == 0
