"""An elastic layer bonded to a rigid base and pressed by a round tip: solved once, then looked up in a table.

The layer is linear, isotropic and (by default) incompressible; the tip presses without friction and its
pressure is Hertz's. Under an axisymmetric pressure p(r) every field is a Hankel transform: for each wave
number k Love's stress function is (A + B k s) exp(-k s) + (C + D k s') exp(-k s'), with s the depth below the
surface and s' = H - s the height above the base, and four linear equations (shear and pressure at the
surface, no displacement at the base) give A to D. Summing over k gives the displacements.

Not modelled are large strain (at 2 mm the tip is a third of the layer deep, where a linear layer folds over near the
axis), friction, viscoelasticity and the sides of the gel. Callers use `ContactTable` only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.gel import Gel


@dataclass(frozen=True)
class ContactTable:
    """Force and displacements of one layer under one tip, on a grid of indentation depth, radius and height.

    `force_n[i]`, and `radial_mm[i, j, l]` (outwards) and `vertical_mm[i, j, l]` (out of the gel, so mostly
    negative) at depth_mm[i] of the material that rests at a distance radius_mm[j] from the axis and a height
    z_mm[l] (0 is the surface, negative below it). All three grids have equal steps, so that finding a cell takes one
    multiplication. `contact_mm` is the contact radius.

    Between depths the force is a power of the depth, with the exponent at the beginning of the table (Hertz's 1.5 for
    a round tip), so that a light touch has its theoretical force. Displacements are interpolated by force, to which
    they are proportional far from the contact.
    """

    depth_mm: Float[np.ndarray, ' depths']
    radius_mm: Float[np.ndarray, ' radii']
    z_mm: Float[np.ndarray, ' heights']
    force_n: Float[np.ndarray, ' depths']
    radial_mm: Float32[np.ndarray, 'depths radii heights']
    vertical_mm: Float32[np.ndarray, 'depths radii heights']
    contact_mm: Float[np.ndarray, ' depths']

    def force_at(self, depth_mm: float) -> float:
        """Normal force [N] at an indentation: 0 above the surface, and at most that at the last depth."""
        low, part = self._cell(depth_mm)
        roots = self._roots
        return float((roots[low] + part * (roots[low + 1] - roots[low])) ** self._power)

    def depth_at(self, force_n: float) -> float:
        """The indentation for a force: the inverse of `force_at`."""
        root = max(force_n, 0.0) ** (1 / self._power)
        return float(np.interp(root, self._roots, self.depth_mm))

    def contact_at(self, depth_mm: float) -> float:
        """Contact radius at an indentation."""
        return float(np.interp(depth_mm, self.depth_mm, self.contact_mm))

    def displacement_at(
        self, depth_mm: float
    ) -> tuple[Float32[np.ndarray, 'radii heights'], Float32[np.ndarray, 'radii heights']]:
        """Radial and vertical displacement at one indentation; between depths they grow in proportion to the force."""
        low, _ = self._cell(depth_mm)
        step_n = float(self.force_n[low + 1] - self.force_n[low])
        part = np.float32((self.force_at(depth_mm) - float(self.force_n[low])) / step_n if step_n > 0 else 0.0)
        radial = self.radial_mm[low] + part * (self.radial_mm[low + 1] - self.radial_mm[low])
        vertical = self.vertical_mm[low] + part * (self.vertical_mm[low + 1] - self.vertical_mm[low])
        return radial, vertical

    def _cell(self, depth_mm: float) -> tuple[int, float]:
        """Index of the tabulated depth below, and the position between it and the next, from 0 to 1."""
        last = len(self._roots) - 1
        place = min(max(depth_mm * self._per_mm, 0.0), float(last))
        low = min(int(place), last - 1)
        return low, place - low

    @cached_property
    def _per_mm(self) -> float:
        return float(1 / self.depth_mm[1])

    @cached_property
    def _power(self) -> float:
        """Exponent of the force at small depths: 1.5 for a sphere, 1 for a flat punch."""
        if len(self.force_n) < 3 or self.force_n[1] <= 0:
            return 1.0
        return float(np.clip(np.log2(self.force_n[2] / self.force_n[1]), 1.0, 2.0))

    @cached_property
    def _roots(self) -> list[float]:
        """The forces to the power 1 / `_power`, in which small depths are linear."""
        roots: list[float] = (self.force_n ** (1 / self._power)).tolist()
        return roots


@dataclass(frozen=True)
class Layer:
    """A linear elastic layer of a thickness, bonded to a rigid base at z = -thickness."""

    thickness_mm: float
    shear_modulus_mpa: float
    poisson_ratio: float = 0.5

    def displacement_mm(
        self, contact_radius_mm: float, radius_mm: Float[np.ndarray, ' r'], z_mm: Float[np.ndarray, ' z']
    ) -> tuple[Float[np.ndarray, 'r z'], Float[np.ndarray, 'r z']]:
        """Radial and vertical displacement under 1 N spread as Hertz's pressure over a contact radius."""
        from scipy.special import j0, j1  # imported here: a camera of a solved gel starts without it

        k, weight = wave_numbers(self.thickness_mm, contact_radius_mm)
        radial_k, vertical_k = self.transforms(k, z_mm)
        load = weight * hertz_transform(k * contact_radius_mm) / (2 * np.pi)
        kr = np.outer(radius_mm, k)
        return (j1(kr) * load) @ radial_k, (j0(kr) * load) @ vertical_k

    def transforms(
        self, k: np.ndarray, z_mm: np.ndarray, load: tuple[float, float] = (0.0, 1.0)
    ) -> tuple[np.ndarray, np.ndarray]:
        """k times the transforms of u_r and u_z for a load (outward shear, pressure) at each wave number, both (k, z).

        The default load is a unit pressure.
        """
        nu, height = self.poisson_ratio, self.thickness_mm
        coefficients = self._coefficients(k, load)
        depth = np.outer(k, -z_mm)
        above = np.outer(k, height + z_mm)
        basis = _derivatives(depth, above)
        slope = np.einsum('ckz,kc->kz', basis[1], coefficients)
        value, curvature = (np.einsum('ckz,kc->kz', basis[order], coefficients) for order in (0, 2))
        scale = 1 / (2 * self.shear_modulus_mpa)
        # Love: 2G u_r = -d²φ/drdz, 2G u_z = 2(1-ν) Laplace(φ) - d²φ/dz²; derivatives are in units of k.
        return scale * slope, scale * ((1 - 2 * nu) * curvature - 2 * (1 - nu) * value)

    def _coefficients(self, k: np.ndarray, load: tuple[float, float]) -> np.ndarray:
        """Amplitudes A to D at each wave number, times k³ (which cancels everywhere), as (k, 4)."""
        nu, thick = self.poisson_ratio, k * self.thickness_mm
        top = [each[:, :, 0] for each in _derivatives(np.zeros((k.size, 1)), thick[:, None])]
        base = [each[:, :, 0] for each in _derivatives(thick[:, None], np.zeros((k.size, 1)))]
        shear = (1 - nu) * (top[2] - top[0]) - top[2]
        pressure = (2 - nu) * (top[3] - top[1]) - top[3]
        equations = np.stack([shear, pressure, base[1], (1 - 2 * nu) * base[2] - 2 * (1 - nu) * base[0]])
        right = np.array([-load[0], -load[1], 0.0, 0.0])
        solved: np.ndarray = np.linalg.solve(equations.transpose(2, 0, 1), np.tile(right, (k.size, 1))[..., None])
        return solved[..., 0]


def _derivatives(depth: np.ndarray, above: np.ndarray) -> list[np.ndarray]:
    """φ and its first three derivatives along z, in units of k, of the four parts of Love's function."""
    down, up = np.exp(-depth), np.exp(-above)
    # With s falling and s' rising along z: d/dz (s^n e^-s) = (s - n) e^-s, and the opposite sign for s'.
    falling = [(down, depth * down), (down, (depth - 1) * down), (down, (depth - 2) * down), (down, (depth - 3) * down)]
    rising = [(up, above * up), (-up, (1 - above) * up), (up, (above - 2) * up), (-up, (3 - above) * up)]
    return [np.stack([*one, *two]) for one, two in zip(falling, rising, strict=True)]


def hertz_transform(x: Float[np.ndarray, ' k']) -> Float[np.ndarray, ' k']:
    """Hankel transform of Hertz's pressure of 1 N, x = k times the contact radius: 3 (sin x - x cos x) / x³."""
    small = np.maximum(x, 1e-2)
    series = 1 - x**2 / 10
    exact: np.ndarray = np.where(x < 1e-2, series, 3 * (np.sin(small) - small * np.cos(small)) / small**3)
    return exact


def wave_numbers(thickness_mm: float, contact_radius_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Wave numbers per mm with their weights (Gauss-Legendre in panels).

    Panels of 0.05 / mm resolve the Bessel functions to 60 mm from the axis. Hertz's transform falls as 1 / k²,
    so the end is where the surface's displacement has converged to a few parts in a thousand.
    """
    ends = np.concatenate([np.arange(0.0, 4.0, 0.1), np.arange(4.0, 60.0 / contact_radius_mm, 0.5)])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    half = np.diff(ends)[:, None] / 2
    k = (ends[:-1, None] + half * (nodes + 1)).ravel()
    keep = k * thickness_mm > 1e-3
    return k[keep], (half * weights).ravel()[keep]


def contact_radius_mm(depth_mm: float, tip_radius_mm: float) -> float:
    """Contact radius of a round-ended rod: Hertz's sqrt(R d) for small depths, never more than the rod's R.

    The paper's tip (R = 0.6 mm) touches over 0.371 mm at 0.25 mm and over 0.575 mm at 2 mm.
    """
    hertz = np.sqrt(tip_radius_mm * depth_mm)
    return float(hertz / (1 + (depth_mm / tip_radius_mm) ** 2) ** 0.25)


def solve(gel: Gel, deepest_mm: float = 2.5, steps: int = 20) -> ContactTable:
    """The table of a gel's own tip, from the surface down to the base of the soft layer.

    The force at a depth is the one that moves the middle of the contact down by that depth.
    """
    layer = Layer(gel.layer_mm, gel.shear_modulus_mpa, gel.poisson_ratio)
    depth = np.linspace(0.0, deepest_mm, steps + 1)
    radius = np.arange(0.0, 3.5 * gel.layer_mm, 0.1)
    z = np.linspace(-gel.layer_mm, 0.0, round(gel.layer_mm / 0.1) + 1)
    force, contact = np.zeros((2, depth.size))
    radial, vertical = np.zeros((2, depth.size, radius.size, z.size))
    for i, each in enumerate(depth[1:], start=1):
        contact[i] = contact_radius_mm(each, gel.tip_radius_mm)
        per_newton_r, per_newton_z = layer.displacement_mm(contact[i], radius, z)
        force[i] = each / -per_newton_z[0, -1]
        radial[i], vertical[i] = force[i] * per_newton_r, force[i] * per_newton_z
    return ContactTable(depth, radius, z, force, radial.astype(np.float32), vertical.astype(np.float32), contact)
