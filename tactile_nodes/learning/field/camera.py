"""The pose of the camera relative to its gel, and the gel's thickness: numbers that a description seldom has right.

They are the place of the pupil along the surface, tilts and roll of the camera, the focal length, and the thickness.
They affect all regions at once, so ten presses determine them; to fit each region separately takes a hundred. Places
are in the frame of the presses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.presses import AllPressures, motion_of, shapes_of, weights_of
from tactile_nodes.learning.transfer.fit import WORTH
from tactile_nodes.sensing.elasticity.regions import Fields, Regions
from tactile_nodes.sensing.explain.camera import STILL, without_camera
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Bool, Float, Int

SCALES = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 0.03, 0.1])
"""Units of the fitted numbers: the place along x and y (mm), both tilts and the roll (degrees), the logarithms of the
focal length and of the gel's thickness. They have no prior: five presses say more than any (`tactile bench fleet`)."""

THICKER = np.array([-0.2, 0.0, 0.2])
"""Logarithms of the thicknesses, over the described one, for which the gel is solved. In between, motion is
interpolated by a parabola."""

AS_DESCRIBED = np.zeros(len(SCALES))
FOCAL, THICKNESS = 5, 6
CAMERA, ALL = 6, 7
"""How many of the numbers are fitted: those of the camera, or all."""

BY_THICKNESS, EXPLAINED = 0.85, 1.2
"""Share of the misfit that another thickness must leave, and the largest misfit with it. Presses fit best a gel that is
a little thinner than it is, because they are deeper than a linear layer allows; this alone must not change it. A wrong
body leaves a larger misfit, and is no reason to change the gel (`pytest test/learning/field -k "thickness or square"`).
"""

LEAST, MOST = 5, 30
"""Presses that are needed, and that are used at most: more hardly improve these numbers."""

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

    The thickness of its gel is fitted, too, if that leaves far less unexplained. Printed dots are described by their
    places on the gel, which follow from the camera. For them both stay.
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
    found = {CAMERA: observed.fitted(rest, CAMERA)}
    found[ALL] = observed.fitted(rest, ALL, found[CAMERA])
    advance(1)
    misfits = {free: observed.misfit(by, rest) for free, by in found.items()}
    described = observed.misfit(AS_DESCRIBED, rest)
    camera_is_better = misfits[CAMERA] * WORTH < described
    free = CAMERA if camera_is_better else 0
    before = misfits[CAMERA] if camera_is_better else described
    if misfits[ALL] < min(BY_THICKNESS * before, EXPLAINED):
        free = ALL
    fitted = observed.fitted(np.ones(len(few), bool), free, found[free]) if free else AS_DESCRIBED
    advance(1)
    return looking(sensor, SCALES * fitted) if free else sensor


def looking(sensor: Sensor, by: Float[np.ndarray, ' numbers']) -> Sensor:
    """A sensor whose camera and thickness differ by numbers in the order of `SCALES`."""
    x, y, about_x, about_y, roll, larger, thicker = by.tolist()
    camera, scale = sensor.camera, math.exp(larger)
    right, down, away = camera.position_mm
    return replace(_thicker(sensor, thicker), camera=replace(
        camera, position_mm=(right + x, down + y, away), roll_deg=camera.roll_deg + roll,
        tilt_deg=(camera.tilt_deg[0] + about_x, camera.tilt_deg[1] + about_y),
        focal_px=(scale * camera.focal_px[0], scale * camera.focal_px[1]),
        focal_px_per_rad=scale * camera.focal_px_per_rad,
    ))  # fmt: skip


def _thicker(sensor: Sensor, by: float) -> Sensor:
    """A sensor with a thicker gel, by this logarithm: the lowest layer is, and the markers in it move with it.

    Raises:
        ValueError: no gel can be so thin, or so thick over this camera.
    """
    if not by:
        return sensor
    gel = sensor.gel
    below = gel.layers_mm[-1] + gel.depth_mm * math.expm1(by)
    above, share = gel.depth_mm - gel.layers_mm[-1], below / gel.layers_mm[-1]
    markers = tuple(each + (share - 1) * max(each - above, 0.0) for each in gel.markers_mm)
    return replace(sensor, gel=replace(gel, layers_mm=(*gel.layers_mm[:-1], below), markers_mm=markers))


def _of_each_thickness(regions: Regions) -> tuple[Regions, ...]:
    """The regions for each thickness of `THICKER`; as described only, if the gel cannot have all of these.

    The same for a gel with sides, because finite elements for each thickness would take too long.
    """
    if regions.sensor.gel.sides != 'ignored':
        return (regions,)
    try:
        return tuple(replace(regions, sensor=_thicker(regions.sensor, by)) for by in THICKER.tolist())
    except ValueError:
        return (regions,)


def looked_otherwise(described: Sensor, fitted: Sensor) -> Float[np.ndarray, ' numbers']:
    """The numbers by which `looking` turns the described sensor into the fitted one."""

    def numbers(sensor: Sensor) -> np.ndarray:
        camera = sensor.camera
        sizes = np.log([camera.focal_lengths_px[0], sensor.gel.depth_mm])
        return np.array([*camera.position_mm[:2], *camera.tilt_deg, camera.roll_deg, *sizes])

    by: np.ndarray = numbers(fitted) - numbers(described)
    return by


def in_words(by: Float[np.ndarray, ' numbers']) -> str:
    """How camera and thickness differ from their description, as the end of a sentence; '' if they do not."""
    if not by.any():
        return ''
    x, y, about_x, about_y, roll, larger, thicker = by.tolist()
    return (
        f'; relative to its description the camera is {x:+.2f} mm along x and {y:+.2f} mm along y, tilted by '
        f'{about_x:+.1f} and {about_y:+.1f} degrees, turned by {roll:+.1f}, its focal length '
        f'{100 * math.expm1(larger):+.1f} %, the thickness of the gel {100 * math.expm1(thicker):+.1f} %'
    )


def focal_objection(by: Float[np.ndarray, ' numbers']) -> str:
    """The objection to a calibration whose camera differs from its description; empty if there is none."""
    share = math.expm1(by[FOCAL])
    if abs(share) <= FARTHEST:
        return ''
    return (
        f'according to the presses the focal length of the camera differs by {100 * share:+.0f} % from the described '
        'one: places have another unit, or the description is of another camera'
    )


@dataclass(frozen=True)
class ObservedPresses:
    """Presses, the motion under them, and the effect of their pressures in the gel, which no camera changes."""

    solved: tuple[Regions, ...]
    known: Int[np.ndarray, ' known']
    motion: Float[np.ndarray, 'n known 2']
    sure: Float[np.ndarray, 'n known 1']
    presses: Float[np.ndarray, 'n 4']
    fields: list[tuple[Int[np.ndarray, ' same'], tuple[Fields, ...]]]
    moving: Float[np.ndarray, 'terms motions']

    @classmethod
    def of(
        cls, regions: Regions, pressures: AllPressures, scaling: InputScaling, dataset: Dataset,
        rows: Int[np.ndarray, ' n'], softer: float, moving: Float[np.ndarray, 'terms motions'],
    ) -> ObservedPresses:  # fmt: skip
        known, motion = motion_of(scaling, dataset, rows)
        shapes = shapes_of(regions, pressures, dataset, rows, softer)
        solved = _of_each_thickness(regions)
        presses = dataset.presses[rows].astype(float)
        fields = [
            (same, tuple(each.fields_under(presses[same, :2], spectrum, slopes=False) for each in solved))
            for same, _, spectrum in shapes
        ]
        sure = np.sqrt(weights_of(scaling, dataset, rows, motion))[..., None]
        return cls(solved, known, motion, sure, presses, fields, moving)

    def predicted(self, by: Float[np.ndarray, ' numbers']) -> Float[np.ndarray, 'n known 2']:
        """The motion predicted for a gel of the described stiffness, over the expected standard deviation.

        Camera and thickness differ from the description by `by`, in units of `SCALES`.
        """
        by = by * SCALES
        shares = _parabola(by[THICKNESS]) if len(self.solved) > 1 else np.ones(1)
        moved = np.zeros(self.motion.shape)
        for number in np.flatnonzero(shares).tolist():
            regions = self.solved[number]
            sensor = looking(regions.sensor, np.append(by[:THICKNESS], 0.0))
            moved += shares[number] * self._moved(replace(regions, sensor=sensor), number)
        return self._still(moved)

    def _moved(self, regions: Regions, number: int) -> Float[np.ndarray, 'n known 2']:
        """The motion predicted for one of the thicknesses."""
        moved = np.zeros(self.motion.shape)
        for same, fields in self.fields:
            one = regions.motion_as_described(fields[number], self.known)
            moved[same] = one * self.presses[same, 3][:, None, None]
        return moved

    def _still(self, motion: Float[np.ndarray, 'n known 2']) -> Float[np.ndarray, 'n known 2']:
        """Motion without that of the camera under the force, over the expected standard deviation."""
        certainty = np.repeat(np.square(self.sure), 2, axis=-1)
        return np.asarray(without_camera(self.moving, motion, certainty) * self.sure)

    def left(self, rest: Bool[np.ndarray, ' n'], by: Float[np.ndarray, ' numbers']) -> Float[np.ndarray, ' motions']:
        """Residuals of some presses, with the gel's softness fitted to them."""
        predicted, motion = self.predicted(by)[rest], self._still(self.motion)[rest]
        return np.asarray((motion - _gain(predicted, motion) * predicted).ravel())

    def fitted(
        self, rest: Bool[np.ndarray, ' n'], free: int, begin: Float[np.ndarray, ' numbers'] = AS_DESCRIBED
    ) -> Float[np.ndarray, ' numbers']:
        """The first `free` numbers fitted to some presses, starting from `begin`, with the slopes there."""
        from scipy.optimize import least_squares

        def left(numbers: np.ndarray) -> np.ndarray:
            return self.left(rest, np.append(numbers, begin[free:]))

        slopes = _slopes(left, begin[:free])
        found = least_squares(left, begin[:free], lambda _: slopes, xtol=ENOUGH, ftol=ENOUGH**2, max_nfev=LOOKS)
        return np.append(found.x, begin[free:])

    def misfit(self, by: Float[np.ndarray, ' numbers'], rest: Bool[np.ndarray, ' n']) -> float:
        """Misfit of the other presses, with the gel's softness fitted to these ones."""
        predicted, motion = self.predicted(by), self._still(self.motion)
        left = (motion - _gain(predicted[rest], motion[rest]) * predicted)[~rest]
        return float(np.sqrt(np.square(left).mean()))


def _parabola(at: float) -> Float[np.ndarray, ' 3']:
    """Shares of three values at `THICKER` in the parabola through them (Lagrange)."""
    low, middle, high = THICKER
    return np.array([
        (at - middle) * (at - high) / ((low - middle) * (low - high)),
        (at - low) * (at - high) / ((middle - low) * (middle - high)),
        (at - low) * (at - middle) / ((high - low) * (high - middle)),
    ])  # fmt: skip


def _slopes(
    left: Callable[[Float[np.ndarray, ' numbers']], Float[np.ndarray, ' motions']], by: Float[np.ndarray, ' numbers']
) -> Float[np.ndarray, 'motions numbers']:
    """Derivatives of the residuals by each number; the steps are large enough for 32 bit floats."""
    at_start = left(by)
    return np.stack([(left(by + step) - at_start) / VARIED for step in VARIED * np.eye(len(by))], axis=1)


def _gain(predicted: np.ndarray, motion: np.ndarray) -> float:
    """The gel's softness as a multiple of the described one."""
    return float((predicted * motion).sum() / max(np.square(predicted).sum(), 1e-12))
