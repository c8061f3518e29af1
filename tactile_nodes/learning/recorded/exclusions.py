"""Which presses are left out of a data set, and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.learning.datasets.labels import outside
from tactile_nodes.learning.recorded.bags import RecordedPress
from tactile_nodes.messages import types
from tactile_nodes.params import parameter
from tactile_nodes.sensing.geometry import BinGrid

REJECTED = 'rejected by the rig'
NOT_SETTLED = 'not settled'
LOST_FRAMES = 'lost frames'
OTHER_TIME = 'images of another time'
LIMITS = 'limits exceeded'
OUTSIDE = 'outside the surface'
NO_REFERENCE = 'no rest image'
BAD_IMAGE = 'image of no use'
BAD_NUMBERS = 'impossible numbers'
DOUBLED = 'doubled'
SUPERSEDED = 'tried again later'
SUSPECT = 'perhaps not at its place'

SIGMAS = 4.0


@dataclass(frozen=True)
class Limits:
    """Limits that a press must meet, in addition to the rig's own checks during the press."""

    force_rate_n_per_s: float = parameter(
        0.2, 'largest change of the force within the window, beyond that from noise', minimum=0.0
    )
    force_deviation_n: float = parameter(0.1, 'largest standard deviation of the force in the window', minimum=0.0)
    depth_error_mm: float = parameter(0.05, 'largest difference between reported and commanded depth', minimum=0.0)
    largest_force_n: float = parameter(math.inf, 'most force', minimum=0.0, maximum=math.inf)
    pull_n: float = parameter(0.05, 'largest force away from the gel, allowed for tare and noise', minimum=0.0)


@dataclass(frozen=True)
class LeftOut:
    """One press that is not in the data set."""

    bag: int
    plan: str
    press: int
    attempt: int
    reason: str
    detail: str

    def as_dict(self) -> dict[str, object]:
        return asdict(self)


Verdict = tuple[str, str]
"""A reason, one of the words above, and its numbers."""


def force_n(message: types.Press) -> float:
    """The force into the gel. The wrench is positive along z, which points out of the gel."""
    return -float(message.wrench.force.z)


def judge(press: RecordedPress, limits: Limits, bins: BinGrid) -> Verdict | None:
    """Why a press cannot be used, judged by its message and stamps; None if it can be used."""
    message = press.message
    if message.status != types.Press.STATUS_RECORDED:
        return REJECTED, message.reason or 'no reason given'
    for verdict in (
        _numbers(press),
        _place(message, bins),
        _settling(press, limits),
        _limits(message, limits),
        _frames(press),
    ):
        if verdict:
            return verdict
    return None


def _numbers(press: RecordedPress) -> Verdict | None:
    message = press.message
    # The other components of the wrench are NaN if a sensor does not measure them.
    if not all(map(math.isfinite, (message.position.x, message.position.y, message.wrench.force.z))):
        return BAD_NUMBERS, 'position or normal force is not a number'
    if math.isinf(message.depth):  # NaN: unknown, as for presses by hand
        return BAD_NUMBERS, 'the depth is not a number'
    if message.depth <= 0:
        return BAD_NUMBERS, f'a depth of {message.depth * 1e3:g} mm is not a press'
    start_ns, end_ns = press.window_ns
    if end_ns <= start_ns:
        return BAD_NUMBERS, 'the window ends before it begins'
    return None


def _place(message: types.Press, bins: BinGrid) -> Verdict | None:
    x_mm, y_mm = message.position.x * 1e3, message.position.y * 1e3
    if outside(x_mm, y_mm, bins):
        return OUTSIDE, f'({x_mm:g}, {y_mm:g}) mm is outside {bins.width_mm:g}x{bins.height_mm:g} mm'
    return None


def _settling(press: RecordedPress, limits: Limits) -> Verdict | None:
    message, deviation = press.message, float(press.message.wrench_deviation.force.z)
    start_ns, end_ns = press.window_ns
    noise = rate_noise(message.force_rate, deviation, message.samples, (end_ns - start_ns) / NS_PER_S)
    if abs(message.force_rate) > limits.force_rate_n_per_s + SIGMAS * noise:
        return NOT_SETTLED, f'force changed by {message.force_rate:+.3g} N/s'
    if deviation > limits.force_deviation_n:
        return NOT_SETTLED, f'force spread by {deviation:.3g} N'
    return None


def rate_noise(rate_n_per_s: float, deviation_n: float, samples: int, window_s: float) -> float:
    """Standard error of a force's slope, from the spread that remains once the slope is removed.

    A spread of 0.01 N in 100 even samples over 0.1 s, with no slope: 0.01 * sqrt(12 / 100) / 0.1 = 0.035 N/s.
    """
    left = deviation_n**2 - (rate_n_per_s * window_s) ** 2 / 12
    if not left > 0 or samples < 1:
        return 0.0
    return math.sqrt(left * 12 / samples) / window_s


def _limits(message: types.Press, limits: Limits) -> Verdict | None:
    force = force_n(message)
    if force > limits.largest_force_n:
        return LIMITS, f'force of {force:.3g} N'
    if force < -limits.pull_n:
        return LIMITS, f'force of {force:.3g} N, away from the gel'
    error_mm = (
        abs(message.depth_reported - message.depth) * 1e3
    )  # NaN if the machine reports none: not a reason to exclude
    if error_mm > limits.depth_error_mm:
        return LIMITS, f'depth {message.depth_reported * 1e3:.3g} mm instead of {message.depth * 1e3:.3g} mm'
    return None


def _frames(press: RecordedPress) -> Verdict | None:
    found, announced = len(press.frames), press.message.frames
    if not found and announced and press.held == announced:
        return OTHER_TIME, 'with its clock corrected, the camera took no image within the window'
    if found == 0 or announced not in (found, press.held):
        return LOST_FRAMES, f'{found} images are in the bag, but {announced} were taken'
    if press.reference is None:
        return NO_REFERENCE, 'the bag holds no rest image from before the window'
    sizes = {frame.image.shape for frame in (*press.frames, press.reference)}
    if len(sizes) > 1:
        return BAD_IMAGE, 'images of the window and rest image differ in size'
    return None


def counted(left_out: Iterable[LeftOut]) -> dict[str, int]:
    """Number of presses excluded for each reason, largest first."""
    return dict(Counter(each.reason for each in left_out).most_common())
