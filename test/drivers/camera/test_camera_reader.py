"""The slot between a device's thread and its reader, and the thread."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tactile_nodes.drivers.camera.reader import FrameReader, NewestFrame
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError

IMAGE = np.zeros((2, 2), np.uint8)


def test_the_newest_frame_takes_the_place_of_an_unread_one() -> None:
    """Five frames, of which one arrives damaged: the last is number 4, the other four are lost."""
    slot = NewestFrame('X')
    for stamp_ns in (10, 20, 30):
        slot.put(IMAGE, stamp_ns)
    slot.miss()
    slot.put(IMAGE, 50)
    frame = slot.take(0)
    assert (frame.stamp_ns, frame.sequence, frame.dropped) == (50, 4, 4)


def test_frames_that_are_read_are_not_lost() -> None:
    slot = NewestFrame('X')
    for number in range(3):
        slot.put(IMAGE, number)
        frame = slot.take(0)
        assert (frame.sequence, frame.dropped) == (number, 0)


def test_an_empty_slot_times_out() -> None:
    with pytest.raises(DeviceTimeoutError, match=r'X sent no complete picture within 0\.01 s'):
        NewestFrame('X').take(0.01)


def test_a_peek_leaves_the_frame() -> None:
    slot = NewestFrame('X')
    slot.put(IMAGE, 1)
    assert slot.peek(0) is slot.take(0)


def test_the_last_frame_comes_before_the_reason_why_it_is_the_last() -> None:
    slot = NewestFrame('X')
    slot.put(IMAGE, 1)
    slot.fail(DeviceLostError('gone'))
    slot.fail(DeviceLostError('a later reason'))
    assert slot.take(0).stamp_ns == 1
    for _ in range(2):
        with pytest.raises(DeviceLostError, match=r'^gone$'):
            slot.take(0)


def test_closing_wakes_a_waiting_reader() -> None:
    slot = NewestFrame('X')
    threading.Timer(0.02, slot.close).start()
    with pytest.raises(DeviceError, match='closed'):
        slot.take(10)


def test_the_thread_releases_the_device_itself_when_it_ends() -> None:
    """And not whoever stops it: a handle released under a running read crashes in the libraries below."""
    releasers = []

    def fetch(slot: NewestFrame) -> None:
        raise DeviceLostError('gone')

    reader = FrameReader('X', fetch, lambda: releasers.append(threading.current_thread().name))
    with pytest.raises(DeviceLostError, match='gone'):
        reader.read(5)
    reader.stop()
    reader.join()
    assert releasers == ['camera X']


def test_stopping_does_not_wait_for_a_device_that_hangs() -> None:
    hanging = threading.Event()
    reader = FrameReader('X', lambda slot: hanging.wait(30) and None, lambda: None)
    reader.stop()
    with pytest.raises(DeviceError, match='closed'):
        reader.read(5)
    hanging.set()
    reader.join()
