"""Waiting above the untouched gel, on a computer that stands still meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.collection.actions import Observation
from tactile_nodes.collection.press.rest import rest_frames, zero
from tactile_nodes.collection.readings import Frame
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

S = 1_000_000_000
PLACE = (0.0, 0.0, 0.0)
SETTINGS = CollectionSettings()
SAMPLES = tuple(Sample((0.0,) * 6, at, at, 0, at, 0, 0, 0, ()) for at in range(10))
FRAMES = tuple(Frame(at, lambda: np.zeros((16, 16), np.uint8)) for at in range(SETTINGS.reference_frames))


def test_a_computer_that_stood_still_is_no_camera_that_sends_too_few_images() -> None:
    procedure = rest_frames(SETTINGS, 0.0)
    next(procedure)
    procedure.send(Observation(0, 0, PLACE))  # at the safe height
    procedure.send(Observation(S, 0, PLACE))
    procedure.send(Observation(31 * S, 0, PLACE, frames=FRAMES[:3]))  # all stood still for half a minute
    with pytest.raises(StopIteration) as ended:
        procedure.send(Observation(32 * S, 0, PLACE, frames=FRAMES))
    assert ended.value.value == FRAMES


def test_a_camera_that_sends_too_few_images_is_named() -> None:
    procedure = rest_frames(SETTINGS, 0.0)
    next(procedure)
    with pytest.raises(DeviceTimeoutError, match=r'too few images in 10 s \(3\); check the camera'):
        for look in range(300):
            procedure.send(Observation(look * S // 20, 0, PLACE, frames=FRAMES[:3]))


def test_a_computer_that_stood_still_is_no_sensor_without_samples() -> None:
    procedure = zero(SETTINGS)
    next(procedure)
    procedure.send(Observation(30 * S, 0, PLACE))
    procedure.send(Observation(30 * S + S // 2, 0, PLACE, SAMPLES))
    with pytest.raises(StopIteration):
        procedure.send(Observation(31 * S, 0, PLACE))  # the tare is set


def test_a_sensor_without_samples_is_named() -> None:
    procedure = zero(SETTINGS)
    next(procedure)
    with pytest.raises(DeviceFaultError, match='no valid force samples from the unloaded sensor'):
        for look in range(1, 12):
            procedure.send(Observation(look * S // 2, 0, PLACE))
