"""Two fingers that squeeze one object: do their readings rise and fall together?

Real recordings without a force sensor still allow one check. Two sensors on the jaws of a gripper feel nearly the same
normal force, so the mean motion of one pattern should follow that of the other, whatever its scale: the correlation
over time is reported, with the largest motion and what is left of it at the end.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.camera.contract import CameraSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import Crop, grey, largest_side
from tactile_nodes.sensing.tracking import FeatureTracker

REGIONS = 12
_SPARSE = 0.05  # share of regions with a pattern: these gels carry 7x5 dots


@dataclass(frozen=True)
class Reading:
    """Mean motion of the pattern of one finger in each frame after the rest image, in pixels."""

    name: str
    motion_px: np.ndarray


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench fingers``."""
    parser.add_argument('first', type=Path, help='video of one finger')
    parser.add_argument('second', type=Path, help='video of the other, recorded in the same loop')
    parser.add_argument('--rest', type=int, default=10, help='number of the frame at rest, from 0 (default: 10)')


def run(arguments: argparse.Namespace) -> int:
    """Measure and print."""
    readings = [read(file, arguments.rest) for file in (arguments.first, arguments.second)]
    print(f'{"finger":<24} {"frames":>6} {"largest":>9} {"at the end":>11}   mean motion of the pattern')
    for reading in readings:
        motion = reading.motion_px
        print(f'{reading.name:<24} {len(motion):>6} {motion.max():>6.2f} px {motion[-1]:>8.2f} px')
    print(f'correlation over time: {agreement(*readings):.3f}')
    return 0


def read(file: Path, rest: int) -> Reading:
    """The motion that a recording shows against its frame number `rest`.

    Raises:
        ConfigurationError: it ends before that frame.
        DeviceError, ImageError: it cannot be read, or shows no pattern at rest.
    """
    flow, encoding = make_flow('dis'), make_encoding('cartesian_mean', {'rows': REGIONS, 'cols': REGIONS})
    tracker = FeatureTracker(flow, encoding, rest_frames=1, marked_share=_SPARSE)
    tracker.begin_capture(skip=rest)
    motion = []
    camera = open_camera(CameraSettings(source=str(file), rate=0.0), SteppedClock(1))
    while (frame := camera.read(1.0)) is not None:
        height, width = frame.image.shape[:2]
        side = largest_side(width, height, 440, step=REGIONS) // REGIONS * REGIONS
        image = np.ascontiguousarray(grey(Crop.centred(width, height, side, side).apply(frame.image)))
        if tracker.capturing:
            tracker.offer_rest(image)
        else:
            motion.append(_mean_motion(tracker, image))
    camera.close()
    if not motion:
        raise ConfigurationError(f'{file} ends before its frame {rest}; choose an earlier one with --rest')
    return Reading(file.stem, np.array(motion))


def agreement(first: Reading, second: Reading) -> float:
    """Pearson's correlation of the two readings over the frames that both have."""
    length = min(len(first.motion_px), len(second.motion_px))
    return float(np.corrcoef(first.motion_px[:length], second.motion_px[:length])[0, 1])


def _mean_motion(tracker: FeatureTracker, image: np.ndarray) -> float:
    features = tracker.features(tracker.field(image))
    motion = np.hypot(features.values[..., 0], features.values[..., 1])
    return float((motion * features.confidence).sum() / features.confidence.sum())
