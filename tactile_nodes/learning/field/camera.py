"""The pose of the camera relative to its gel, fitted to presses: six numbers that a description seldom has right.

The six are the place of the pupil along the surface, tilts and roll of the camera, and the focal length. They affect
all regions at once, so ten presses determine them; to fit each region separately takes a hundred. Places are in the
frame of the presses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.presses import AllPressures, motion_of, shapes_of, weights_of
from tactile_nodes.learning.transfer.fit import WORTH
from tactile_nodes.sensing.elasticity.regions import Fields, Regions
from tactile_nodes.sensing.explain.camera import STILL, without_camera
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Bool, Float, Int

SCALES = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 0.03])
"""Units of the fitted numbers: the place along x and y (mm), both tilts and the roll (degrees), the logarithm of
the focal length. They have no prior: five presses say more than any (`tactile bench fleet`)."""

AS_DESCRIBED = np.zeros(len(SCALES))

LEAST, MOST = 5, 30
"""Presses that are needed, and that are used at most: more hardly improve six numbers."""

FARTHEST = 0.2
"""Largest relative difference of the focal length from its description. Beyond it, places, images or the description
are of something else."""

VARIED, ENOUGH, LOOKS = 0.05, 0.01, 12
"""Step of each number for slopes, in its scale; change that counts as converged; most cameras that are tried."""


def fitted_camera(
    regions: Regions,
    pressures: AllPressures,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' n'],
    fold: Int[np.ndarray, ' n'],
    softer: float = 1.0,
    moving: Float[np.ndarray, 'terms motions'] = STILL,
    advance: Callable[[int], object] = lambda _: None,
) -> Sensor:
    """The sensor with its camera fitted to presses; as described, if that explains held-out presses nearly as well.

    Printed dots are described by their places on the gel, which follow from the camera. For them the camera stays.
    `softer` is as in `presses_of`, `moving` as `axisymmetric.regions.Presses.camera`. `advance` is called twice to
    report progress.
    """
    sensor = regions.sensor
    if len(rows) < LEAST or len(np.unique(fold)) < 2 or sensor.pattern.kind == 'dots':
        advance(2)
        return sensor
    few = np.arange(len(rows))[:: math.ceil(len(rows) / MOST)]
    observed = ObservedPresses.of(regions, pressures, scaling, dataset, rows[few], softer, moving)
    rest = fold[few] != fold[0]
    found = observed.fitted(rest)
    advance(1)
    better = observed.misfit(found, rest) * WORTH < observed.misfit(AS_DESCRIBED, rest)
    camera = looking(sensor, SCALES * observed.fitted(np.ones(len(few), bool), found)) if better else sensor
    advance(1)
    return camera


def looking(sensor: Sensor, by: Float[np.ndarray, ' 6']) -> Sensor:
    """A sensor whose camera differs by six numbers, in units of `SCALES`."""
    x, y, about_x, about_y, roll, larger = by.tolist()
    camera, scale = sensor.camera, math.exp(larger)
    right, down, away = camera.position_mm
    return replace(sensor, camera=replace(
        camera, position_mm=(right + x, down + y, away), roll_deg=camera.roll_deg + roll,
        tilt_deg=(camera.tilt_deg[0] + about_x, camera.tilt_deg[1] + about_y),
        focal_px=(scale * camera.focal_px[0], scale * camera.focal_px[1]),
        focal_px_per_rad=scale * camera.focal_px_per_rad,
    ))  # fmt: skip


def looked_otherwise(described: Sensor, fitted: Sensor) -> Float[np.ndarray, ' 6']:
    """The six numbers by which `looking` turns the described sensor into the fitted one."""

    def six(sensor: Sensor) -> np.ndarray:
        camera = sensor.camera
        scale = math.log(camera.focal_lengths_px[0])
        return np.array([*camera.position_mm[:2], *camera.tilt_deg, camera.roll_deg, scale])

    by: np.ndarray = six(fitted) - six(described)
    return by


def in_words(by: Float[np.ndarray, ' 6']) -> str:
    """How a camera differs from its description, as the end of a sentence; '' if it does not."""
    if not by.any():
        return ''
    x, y, about_x, about_y, roll, larger = by.tolist()
    return (
        f'; relative to its description the camera is {x:+.2f} mm along x and {y:+.2f} mm along y, tilted by '
        f'{about_x:+.1f} and {about_y:+.1f} degrees, turned by {roll:+.1f}, its focal length '
        f'{100 * math.expm1(larger):+.1f} %'
    )


def focal_objection(by: Float[np.ndarray, ' 6']) -> str:
    """The objection to a calibration whose camera differs from its description; empty if there is none."""
    share = math.expm1(by[-1])
    if abs(share) <= FARTHEST:
        return ''
    return (
        f'according to the presses the focal length of the camera differs by {100 * share:+.0f} % from the described '
        'one: places have another unit, or the description is of another camera'
    )


@dataclass(frozen=True)
class ObservedPresses:
    """Presses, the motion under them, and the effect of their pressures in the gel, which no camera changes."""

    regions: Regions
    known: Int[np.ndarray, ' known']
    motion: Float[np.ndarray, 'n known 2']
    sure: Float[np.ndarray, 'n known 1']
    presses: Float[np.ndarray, 'n 4']
    fields: list[tuple[Int[np.ndarray, ' same'], Fields]]
    moving: Float[np.ndarray, 'terms motions']

    @classmethod
    def of(
        cls, regions: Regions, pressures: AllPressures, scaling: InputScaling, dataset: Dataset,
        rows: Int[np.ndarray, ' n'], softer: float, moving: Float[np.ndarray, 'terms motions'],
    ) -> ObservedPresses:  # fmt: skip
        known, motion = motion_of(scaling, dataset, rows)
        shapes = shapes_of(regions, pressures, dataset, rows, softer)
        fields = [(same, regions.fields_under(spectrum, slopes=False)) for same, _, spectrum in shapes]
        sure = np.sqrt(weights_of(scaling, dataset, rows, motion))[..., None]
        return cls(regions, known, motion, sure, dataset.presses[rows].astype(float), fields, moving)

    def predicted(self, by: Float[np.ndarray, ' 6']) -> Float[np.ndarray, 'n known 2']:
        """The motion predicted for a gel of the described stiffness, over the expected standard deviation.

        The camera differs from its description by `by`, in units of `SCALES`.
        """
        regions = replace(self.regions, sensor=looking(self.regions.sensor, by * SCALES))
        moved = np.zeros(self.motion.shape)
        for same, fields in self.fields:
            one = regions.motion_as_described(self.presses[same, :2], fields, self.known)
            moved[same] = one * self.presses[same, 3][:, None, None]
        return self._still(moved)

    def _still(self, motion: Float[np.ndarray, 'n known 2']) -> Float[np.ndarray, 'n known 2']:
        """Motion without that of the camera under the force, over the expected standard deviation."""
        certainty = np.repeat(np.square(self.sure), 2, axis=-1)
        return np.asarray(without_camera(self.moving, motion, certainty) * self.sure)

    def left(self, rest: Bool[np.ndarray, ' n'], by: Float[np.ndarray, ' 6']) -> Float[np.ndarray, ' numbers']:
        """Residuals of some presses, with the gel's softness fitted to them."""
        predicted, motion = self.predicted(by)[rest], self._still(self.motion)[rest]
        return np.asarray((motion - _gain(predicted, motion) * predicted).ravel())

    def fitted(self, rest: Bool[np.ndarray, ' n'], begin: Float[np.ndarray, ' 6'] = AS_DESCRIBED) -> np.ndarray:
        """The camera fitted to some presses, starting from `begin`, with the slopes there."""
        from scipy.optimize import least_squares

        left = partial(self.left, rest)
        slopes = _slopes(left, begin)
        found = least_squares(left, begin, lambda _: slopes, xtol=ENOUGH, ftol=ENOUGH**2, max_nfev=LOOKS)
        return np.asarray(found.x)

    def misfit(self, by: Float[np.ndarray, ' 6'], rest: Bool[np.ndarray, ' n']) -> float:
        """Misfit of the other presses, with the gel's softness fitted to these ones."""
        predicted, motion = self.predicted(by), self._still(self.motion)
        left = (motion - _gain(predicted[rest], motion[rest]) * predicted)[~rest]
        return float(np.sqrt(np.square(left).mean()))


def _slopes(
    left: Callable[[Float[np.ndarray, ' 6']], Float[np.ndarray, ' numbers']], by: Float[np.ndarray, ' 6']
) -> Float[np.ndarray, 'numbers 6']:
    """Derivatives of the residuals by each number; the steps are large enough for 32 bit floats."""
    at_start = left(by)
    return np.stack([(left(by + step) - at_start) / VARIED for step in VARIED * np.eye(len(by))], axis=1)


def _gain(predicted: np.ndarray, motion: np.ndarray) -> float:
    """The gel's softness as a multiple of the described one."""
    return float((predicted * motion).sum() / max(np.square(predicted).sum(), 1e-12))
