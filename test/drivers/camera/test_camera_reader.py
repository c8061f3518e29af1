"""The slot between a device's thread and its reader."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.camera.reader import NewestFrame
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError, ImageError

IMAGE = np.zeros((2, 2), np.uint8)


@pytest.fixture
def slot() -> NewestFrame:
    return NewestFrame('X', SystemClock())


def test_the_newest_frame_takes_the_place_of_an_unread_one(slot: NewestFrame) -> None:
    """Five frames, of which one arrives damaged: the last is number 4, the other four are lost."""
    for stamp_ns in (10, 20, 30):
        slot.put(IMAGE, stamp_ns)
    slot.miss()
    slot.put(IMAGE, 50)
    frame = slot.take(0)
    assert (frame.stamp_ns, frame.sequence, frame.dropped) == (50, 4, 4)


def test_frames_that_are_read_are_not_lost(slot: NewestFrame) -> None:
    for number in range(3):
        slot.put(IMAGE, number)
        frame = slot.take(0)
        assert (frame.sequence, frame.dropped) == (number, 0)


def test_an_empty_slot_times_out(slot: NewestFrame) -> None:
    with pytest.raises(DeviceTimeoutError, match=r'X sent no complete picture within 0\.01 s'):
        slot.take(0.01)


def test_a_camera_that_is_lost_right_after_its_first_frame_has_sent_one_and_then_times_out_with_the_reason(
    slot: NewestFrame,
) -> None:
    slot.put(IMAGE, 1)
    slot.fail(DeviceLostError('gone'))
    slot.first(0)
    assert slot.take(0).stamp_ns == 1
    with pytest.raises(DeviceTimeoutError, match=r'X is lost \(gone\); reconnecting'):
        slot.take(0)


def test_a_camera_of_the_wrong_size_is_an_error(slot: NewestFrame) -> None:
    slot.fail(ImageError('X gives pictures of 1x1'))
    with pytest.raises(ImageError):
        slot.take(10)


def test_closing_wakes_a_waiting_reader(slot: NewestFrame) -> None:
    threading.Timer(0.02, slot.close).start()
    with pytest.raises(DeviceError, match='closed'):
        slot.take(10)
