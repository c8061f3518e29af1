"""A rigid body pressed into a layer, dragged and twisted: equilibrium at finite strain, solved with its contact.

Each step computes the layer's forces, predicts the surface with the linear response, finds the contact forces on that
surface, and moves the layer by both. These are Newton steps with the stiffness of the layer at rest, so larger strain
takes more steps. If they do not converge, the path is divided more finely.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Bool, Float, Float32
from tactile_nodes.simulation.touch.body import NO_BODY_MM, Body
from tactile_nodes.simulation.touch.bricks import Bricks, State
from tactile_nodes.simulation.touch.friction import Gap, Surface

TOLERANCE = 1e-3
"""Tolerance of the forces on inner nodes, and of the change of contact forces, over all contact forces."""
MOST_STEPS = 60
LEAST_FORCE = 0.1
"""Forces [mm²] below this count as zero."""
SOME_NODES = 12
NEAR = 0.9
"""Share of the wanted force that may be missing for the force to determine the body's height."""
FIRST = 1 / 8
"""Share of the path taken first while nothing touches yet."""
FIRST_MM = 0.02
"""First guess of the contact: points this near to the lowest point of a body touch."""
FAR_MM = 0.3
"""Gaps are limited to this: a body further away has no effect."""
FINEST = 1 / 16
"""Finest division of a path, as a share."""
_REMEMBERED = 5


@dataclass(frozen=True)
class Pose:
    """Pose of a body: its origin on the surface, and its rotation (counter-clockwise seen along z, rad)."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    turn_rad: float = 0.0

    def towards(self, other: Pose, share: float) -> Pose:
        """The pose at a share of the path to another."""
        here, there = (np.array([each.x_mm, each.y_mm, each.turn_rad]) for each in (self, other))
        return Pose(*(here + share * (there - here)).tolist())


@dataclass
class Standing:
    """A layer under a body in equilibrium.

    `force` is the force on each node of the surface (over the unit; z out of the gel). `stuck_at` is the position of
    each node on the body when it last slipped or was free (body's frame), and `slips` marks slipping nodes.
    """

    pose: Pose
    depth_mm: float
    state: State
    force: Float[np.ndarray, '3 y x']
    stuck_at: Float[np.ndarray, '2 y x']
    slips: Bool[np.ndarray, 'y x']

    @property
    def normal(self) -> float:
        """Sum of the forces into the gel."""
        return float(-self.force[2].sum())


class Pressing:
    """A body on a layer, from the first touch on; `standing` is the present state.

    Messages give forces on a gel of `shear_modulus_mpa`.
    """

    def __init__(self, bricks: Bricks, body: Body, friction: float = 0.6, shear_modulus_mpa: float = 1.0) -> None:
        layer = bricks.layer
        if body.reach_mm > layer.width_mm / 2:
            raise ConfigurationError(
                f'the body {body.name!r} reaches {body.reach_mm:.1f} mm from its middle, but the gel ends at '
                f'{layer.width_mm / 2:.1f} mm; give a smaller body'
            )
        self._bricks, self._body, self._friction, self._modulus_mpa = bricks, body, friction, shear_modulus_mpa
        surface = bricks.inverse[:, bricks.surface, bricks.surface].astype(np.complex128)
        self._surface = Surface(surface.reshape(layer.cells, -1, 3, 3))
        self._x, self._y = np.meshgrid(layer.line_mm, layer.line_mm)
        place = np.stack([self._x, self._y])
        self.standing = Standing(
            Pose(), 0.0, bricks.at_rest(), np.zeros((3, *self._x.shape)), place, np.zeros(self._x.shape, bool)
        )

    def advance(self, pose: Pose, force: float | None = None, depth_mm: float | None = None) -> Standing:
        """Move to a pose and to a normal force [mm²] or a depth, in finer steps where needed.

        Raises:
            ConfigurationError: no equilibrium was found because the strain is too large.
        """
        start, done = self.standing, 0.0
        by_depth = force is None
        first, last = (start.depth_mm, depth_mm or 0.0) if force is None else (start.normal, force)
        step = 1.0 if start.normal else FIRST
        while done < 1:
            share = min(1.0, done + step)
            wanted = first + share * (last - first)
            found = self._equilibrium(start.pose.towards(pose, share), wanted, by_depth)
            if found is not None:
                self.standing, done, step = found, share, min(1.0, 2 * step)
            elif step > FINEST:
                step /= 2
            else:
                target = f'{wanted:.2f} mm deep' if by_depth else f'at {wanted * self._modulus_mpa:.2f} N'
                raise ConfigurationError(
                    f'no equilibrium found for the body {self._body.name!r} {target}; press, drag and twist it '
                    'less, or use a rounder body'
                )
        return self.standing

    def _equilibrium(self, pose: Pose, wanted: float, by_depth: bool = False) -> Standing | None:
        """The layer under the body at a pose, with a normal force or a depth, starting from the present state."""
        now = self.standing
        at, remembered = self._vector(now.state, now.force, wanted if by_depth else now.depth_mm), _Anderson()
        for _ in range(MOST_STEPS):
            state, force, depth_mm = self._parts(at)
            inner, lacking, least = self._bricks.forces(state)
            if not least > 0:
                return None
            residual = -inner
            residual[-1] += force
            waves = self._bricks.spectrum(residual, -lacking)
            gap = self._gap(pose, depth_mm, state.moved[-1] + self._surface_of(waves), now)
            near = not by_depth and self._holds(force, wanted)
            found, left = self._surface.forces(force, gap, self._friction, wanted if near else None)
            missing = 0.0 if by_depth else wanted + float(found[2].sum())
            off = max(_size(residual), _size(found - force), abs(missing)) / max(_size(found), LEAST_FORCE)
            if not np.isfinite(off):
                return None
            if off < TOLERANCE:
                return self._settled(pose, depth_mm, state, force, gap, now)
            residual[-1] += found - force
            du, dp = self._bricks.answer(residual, -lacking)
            deeper = 0.0 if by_depth else _closing(left, gap, found) if near else self._deeper(missing, found, gap)
            step = self._vector(State(np.concatenate([np.zeros_like(du[:1]), du]), dp), found - force, deeper)
            at = remembered.next(at, step)
        return None

    def _vector(self, state: State, force: np.ndarray, depth_mm: float) -> Float32[np.ndarray, ' unknowns']:
        """All unknowns as one vector, each scaled to about the size of its strain."""
        h = self._bricks.layer.spacing_mm
        parts = state.moved[1:] / h, state.pressure, force / h**2, np.array([depth_mm / h])
        return np.concatenate([each.ravel() for each in parts]).astype(np.float32)

    def _parts(self, vector: np.ndarray) -> tuple[State, np.ndarray, float]:
        layer = self._bricks.layer
        plane, h = layer.cells**2, layer.spacing_mm
        moved, pressure, force, depth = np.split(
            vector, np.cumsum([3 * layer.rows * plane, layer.rows * plane, 3 * plane])
        )
        shape = layer.cells, layer.cells
        moved = np.concatenate([np.zeros(3 * plane, np.float32), moved]).reshape(-1, 3, *shape) * np.float32(h)
        state = State(moved, pressure.reshape(-1, *shape))
        return state, force.reshape(3, *shape).astype(float) * h**2, float(depth[0]) * h

    @staticmethod
    def _holds(force: np.ndarray, wanted: float) -> bool:
        """Whether enough nodes bear enough of the wanted force for the force to determine the body's height."""
        some = np.count_nonzero(force[2] < 0) >= SOME_NODES
        return bool(some and abs(wanted + float(force[2].sum())) < NEAR * wanted)

    def _deeper(self, missing: float, found: np.ndarray, gap: Gap) -> float:
        """How much lower the body must go for a missing force, as for a disc of the contact's area on a half-space."""
        touching = found[2] < 0
        there = touching if touching.any() else gap.apart < gap.apart.min() + FIRST_MM
        radius_mm = self._bricks.layer.spacing_mm * np.sqrt(np.count_nonzero(there) / np.pi)
        apart = 0.0 if touching.any() else max(0.0, float(gap.apart.min()))
        return float(missing / (8 * radius_mm) + apart)

    def _surface_of(self, waves: np.ndarray) -> np.ndarray:
        """Motion of the surface in the linear response to loads."""
        cells = self._bricks.layer.cells
        moved = np.einsum('mij,jm->im', self._bricks.inverse[:, self._bricks.surface], waves)
        answer: np.ndarray = np.fft.irfft2(moved.reshape(3, cells, -1), s=(cells, cells))
        return answer

    def _gap(self, pose: Pose, depth_mm: float, moved: np.ndarray, before: Standing) -> Gap:
        """The gap between the moved surface and the body."""
        on_body = self._on_body(pose, moved)
        height, along_x, along_y = self._body.under(*on_body)
        slopes = _turned(np.stack([along_x, along_y]), pose.turn_rad)
        length = np.sqrt(1 + (slopes * slopes).sum(axis=0))
        normal = np.stack([*slopes, -np.ones_like(height)]) / length
        apart = np.minimum((height - depth_mm - moved[2]) / length, FAR_MM)
        slip = np.zeros_like(normal)
        slip[:2] = _turned(on_body - before.stuck_at, pose.turn_rad)
        slip -= normal * (slip * normal).sum(axis=0)
        return Gap(normal, apart, slip * (height < NO_BODY_MM) * (apart < FAR_MM))

    def _on_body(self, pose: Pose, moved: np.ndarray) -> np.ndarray:
        """The surface's nodes in the body's frame."""
        away = np.stack([self._x + moved[0] - pose.x_mm, self._y + moved[1] - pose.y_mm])
        return _turned(away, -pose.turn_rad)

    def _settled(
        self, pose: Pose, depth_mm: float, state: State, force: np.ndarray, gap: Gap, before: Standing
    ) -> Standing:
        pressing = (force * gap.normal).sum(axis=0)
        aside = np.sqrt(((force - gap.normal * pressing) ** 2).sum(axis=0))
        touches = pressing > 0
        slips = touches & (aside >= (1 - TOLERANCE) * self._friction * pressing)
        on_body = self._on_body(pose, state.moved[-1])
        stuck_at = np.where(touches & ~slips, before.stuck_at, on_body)
        return Standing(pose, depth_mm, state, force, stuck_at, slips)


def _closing(left: np.ndarray, gap: Gap, force: np.ndarray) -> float:
    """How much lower the body must go so that the force-weighted mean gap of its contact is zero."""
    pressing = np.maximum((force * gap.normal).sum(axis=0), 0.0)
    if not pressing.any():
        return float(gap.apart.min())
    apart = (left * gap.normal).sum(axis=0) / np.maximum(-gap.normal[2], 0.1)
    return float((apart * pressing).sum() / pressing.sum())


def _turned(vectors: np.ndarray, angle_rad: float) -> np.ndarray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([cos * vectors[0] - sin * vectors[1], sin * vectors[0] + cos * vectors[1]])


def _size(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values, dtype=np.float64).sum()))


class _Anderson:
    """Anderson acceleration: stores a few positions and steps; `next` gives the position after one with a known step.

    The next position is the combination of the last ones whose step would be smallest (D. G. Anderson, J. ACM 12, 1965;
    Walker and Ni, SIAM J. Numer. Anal. 49, 2011).
    """

    def __init__(self) -> None:
        self._places: deque[np.ndarray] = deque(maxlen=_REMEMBERED)
        self._steps: deque[np.ndarray] = deque(maxlen=_REMEMBERED)
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, at: Float[np.ndarray, ' n'], step: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
        """The next position; the first time it is `at + step`."""
        if self._last is not None:
            self._places.append(at - self._last[0])
            self._steps.append(step - self._last[1])
        self._last = at, step
        ahead: np.ndarray = at + step
        if not self._steps:
            return ahead
        normal = np.array([[np.vdot(one, other) for other in self._steps] for one in self._steps], float)
        right = np.array([np.vdot(each, step) for each in self._steps], float)
        normal[np.diag_indices(len(normal))] *= 1 + 1e-8
        for share, place, change in zip(
            np.linalg.lstsq(normal, right, rcond=None)[0], self._places, self._steps, strict=True
        ):
            ahead = ahead - share.astype(ahead.dtype) * (place + change)
        return ahead
