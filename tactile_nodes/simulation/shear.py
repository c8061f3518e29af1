"""A bonded layer dragged sideways by a disc that sticks to its surface: linear elasticity, by Fourier transform.

At every wave vector a tangential traction along x splits into two parts. Love's function solves the part along the
wave vector. The part across it shears the layer like a deck of cards, sinh k(H + z) / (G k cosh kH). In total

    u_x = even + twin cos 2t,   u_y = twin sin 2t,   u_z = lift cos t,   with t the angle from the drag's direction.

The fields are those of the undeformed layer under the traction that moves a rigid disc of the contact's radius on a
half-space (Mindlin). docs/simulation.md gives the error of this for a tip deep in the gel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, Layer, wave_numbers


@dataclass(frozen=True)
class ShearTable:
    """Displacements of the layer per mm of sideways motion of the contact, by contact radius, radius and height.

    `stiffness_n_mm[i]` is the drag per mm at contact radius contact_mm[i]. The grids have equal steps.
    """

    contact_mm: Float[np.ndarray, ' contacts']
    radius_mm: Float[np.ndarray, ' radii']
    z_mm: Float[np.ndarray, ' heights']
    stiffness_n_mm: Float[np.ndarray, ' contacts']
    fields: Float32[np.ndarray, 'contacts radii heights 3']
    """even, twin and lift."""

    def at(self, contact_mm: float) -> Float32[np.ndarray, 'radii heights 3']:
        """The fields at one contact radius, linear between those tabulated."""
        step = self.contact_mm[1] - self.contact_mm[0]
        place = float(np.clip((contact_mm - self.contact_mm[0]) / step, 0, len(self.contact_mm) - 1))
        low = min(int(place), len(self.contact_mm) - 2)
        mixed: np.ndarray = self.fields[low] + np.float32(place - low) * (self.fields[low + 1] - self.fields[low])
        return mixed

    def force_n(self, contact_mm: float, shift_mm: tuple[float, float]) -> tuple[float, float]:
        """The drag on the gel (x, y) under a sideways motion of the contact; 0 without contact."""
        if contact_mm <= 0:
            return 0.0, 0.0
        stiffness = float(np.interp(contact_mm, self.contact_mm, self.stiffness_n_mm))
        return stiffness * shift_mm[0], stiffness * shift_mm[1]

    def displacement_mm(
        self, contact_mm: float, points_mm: Float32[np.ndarray, 'points 3'], shift_mm: tuple[float, float]
    ) -> Float32[np.ndarray, 'points 3']:
        """Displacement of points (relative to the contact) under its sideways motion, linear between grid points."""
        from scipy.ndimage import map_coordinates  # imported here: only a tip that moves sideways needs it

        size, distance = float(np.hypot(*shift_mm)), np.hypot(points_mm[:, 0], points_mm[:, 1])
        way = np.array(shift_mm, np.float32) / size
        ahead = points_mm[:, :2] @ way / np.maximum(distance, 1e-6)
        aside = (points_mm[:, 1] * way[0] - points_mm[:, 0] * way[1]) / np.maximum(distance, 1e-6)
        height = (points_mm[:, 2] - self.z_mm[0]) / (self.z_mm[1] - self.z_mm[0])
        place = np.stack([np.minimum(distance / self.radius_mm[1], len(self.radius_mm) - 1), height])
        fields = size * np.moveaxis(self.at(contact_mm), -1, 0)
        even, twin, lift = (map_coordinates(each, place, order=1, mode='nearest') for each in fields)
        along, across = even + twin * (2 * ahead**2 - 1), 2 * twin * ahead * aside
        plane = along[:, None] * way + across[:, None] * np.array([-way[1], way[0]])
        return np.column_stack([plane, lift * ahead]).astype(np.float32)


def shear_per_newton(
    layer: Layer, contact_mm: float, radius_mm: Float[np.ndarray, ' r'], z_mm: Float[np.ndarray, ' z']
) -> tuple[Float[np.ndarray, 'r z'], Float[np.ndarray, 'r z'], Float[np.ndarray, 'r z']]:
    """The fields even, twin and lift under 1 N along x on a disc."""
    from scipy.special import j0, j1  # as above

    k, weight = wave_numbers(layer.thickness_mm, contact_mm)
    along, up = layer.transforms(k, z_mm, load=(1.0, 0.0))
    depth = np.outer(k, -z_mm)
    twice = 2 * k[:, None] * layer.thickness_mm
    across = (np.exp(-depth) - np.exp(depth - twice)) / (1 + np.exp(-twice)) / layer.shear_modulus_mpa
    load = weight * np.sinc(k * contact_mm / np.pi) / (4 * np.pi)
    kr = np.maximum(np.outer(radius_mm, k), 1e-9)
    zeroth, first = j0(kr), j1(kr)
    second = 2 * first / kr - zeroth  # faster than scipy's function of any order
    return (zeroth * load) @ (along + across), -(second * load) @ (along - across), -2 * (first * load) @ up


def shear_of(gel: Gel, table: ContactTable) -> ShearTable:
    """The table of a gel's own layer."""
    return solve_shear(Layer(gel.layer_mm, gel.shear_modulus_mpa, gel.poisson_ratio), table)


def solve_shear(layer: Layer, table: ContactTable, steps: int = 6) -> ShearTable:
    """The table for all contact radii of a contact table, on a grid twice as coarse."""
    contact = np.linspace(table.contact_mm.max() / steps, table.contact_mm.max(), steps)
    radius, z = table.radius_mm[::2], np.linspace(table.z_mm[0], 0.0, len(table.z_mm) // 2 + 1)
    stiffness, fields = np.zeros(steps), []
    for i, each in enumerate(contact.tolist()):
        even, twin, lift = shear_per_newton(layer, each, radius, z)
        stiffness[i] = 1 / even[0, -1]
        fields.append(stiffness[i] * np.stack([even, twin, lift], -1))
    return ShearTable(contact, radius, z, stiffness, np.stack(fields).astype(np.float32))
