"""Two fingers that squeeze one object: do their readings rise and fall together?

Real recordings without a force sensor still allow one check. Two sensors on the jaws of a gripper feel nearly the same
normal force, so the mean motion of one pattern should follow that of the other, whatever its scale: the correlation
over time is reported, with the largest motion and what is left of it at the end.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.declaration import Benchmark, Result, argument
from benchmarks.harness.report import table
from benchmarks.harness.running import Run
from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.camera.contract import CameraSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import Crop, grey, largest_side
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest

REGIONS = 12
_SPARSE = 0.05  # share of regions with a pattern: these gels carry 7x5 dots


@dataclass(frozen=True)
class Reading:
    """Mean motion of the pattern of one finger in each frame after the rest image, in pixels."""

    name: str
    motion_px: np.ndarray


def read(file: Path, rest: int) -> Reading:
    """The motion that a recording shows against its frame number `rest`.

    Raises:
        ConfigurationError: it ends before that frame.
        DeviceError, ImageError: it cannot be read, or shows no pattern at rest.
    """
    encoding = make_encoding('cartesian_mean', {'rows': REGIONS, 'cols': REGIONS})
    measuring = Measuring(make_flow('dis'), encoding, marked_share=_SPARSE)
    beside: PreparedRest | None = None
    motion, number = [], 0
    camera = open_camera(CameraSettings(source=str(file), rate=0.0), SteppedClock(1))
    while (frame := camera.read(1.0)) is not None:
        height, width = frame.image.shape[:2]
        side = largest_side(width, height, 440, step=REGIONS) // REGIONS * REGIONS
        image = np.ascontiguousarray(grey(Crop.centred(width, height, side, side).apply(frame.image)))
        if beside is not None:
            motion.append(_mean_motion(beside, image))
        elif number == rest:
            beside = measuring.beside(image)
        number += 1
    camera.close()
    if not motion:
        raise ConfigurationError(f'{file} ends before its frame {rest}; choose an earlier one with --rest')
    return Reading(file.stem, np.array(motion))


def agreement(first: Reading, second: Reading) -> float:
    """Pearson's correlation of the two readings over the frames that both have."""
    length = min(len(first.motion_px), len(second.motion_px))
    return float(np.corrcoef(first.motion_px[:length], second.motion_px[:length])[0, 1])


def _mean_motion(rest: PreparedRest, image: np.ndarray) -> float:
    features = rest.features(image)
    motion = np.hypot(features.values[..., 0], features.values[..., 1])
    return float((motion * features.confidence).sum() / features.confidence.sum())


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Both recordings."""
    readings = [read(file, arguments.rest) for file in (arguments.first, arguments.second)]
    fingers = {
        each.name: {'frames': len(each.motion_px), 'largest': each.motion_px.max(), 'end': each.motion_px[-1]}
        for each in readings
    }
    return {'fingers': fingers, 'correlation': agreement(*readings)}


def told(result: Mapping[str, Any]) -> str:
    """A row a finger."""
    rows = [
        [name, str(each['frames']), f'{each["largest"]:.2f} px', f'{each["end"]:.2f} px']
        for name, each in result['fingers'].items()
    ]
    shown = table(['finger', 'frames', 'largest mean motion of the pattern', 'at the end'], rows)
    return f'{shown}\n\ncorrelation over time: {result["correlation"]:.3f}'


BENCHMARK = Benchmark(
    name='fingers',
    about=__doc__,
    sources=('benchmarks/fingers.py', 'tactile_nodes/sensing/**'),
    page=told,
    measure=measured,
    files=('live.md',),
    by_hand=True,
    keeps=False,
    arguments=(
        argument('first', type=Path, help='video of one finger'),
        argument('second', type=Path, help='video of the other, recorded in the same loop'),
        argument('--rest', type=int, default=10, help='number of the frame at rest, from 0 (default: 10)'),
    ),
)
