"""Reported values of a force field and of tips: present places of forces, their sums, and the uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.field.contacts import numbers_of_contacts
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.field.where_now import moved_along
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.shapes import Float, Float32


@dataclass(frozen=True)
class Sums:
    """Sums of a field whose forces are at their present places.

    `bins_n` are forces on bins, into the gel, along x and along y. `bins_off_n` are the fit's standard deviations of
    the normal ones. `wrench` is force x, y, z [N] and torque x, y, z [N mm] on the gel about the frame's origin, with
    the covariance of the fit. `contacts` are as in `numbers_of_contacts`, in any order.
    """

    field: Field
    bins_n: Float[np.ndarray, '3 rows cols']
    bins_off_n: Float[np.ndarray, 'rows cols']
    wrench: Float[np.ndarray, ' 6']
    wrench_covariance: Float[np.ndarray, '6 6']
    contacts: Float[np.ndarray, 'contacts 16']


def sums(
    found: Field, surface: Float32[np.ndarray, '2 near near'], patches: PatchGrid, *, compiled: bool = False
) -> Sums:
    """The sums of a field as it was solved; `surface` is as in `moved_along`."""
    if compiled:
        return _by_loops(found, surface, patches)
    field = replace(found, forces_n=moved_along(found.forces_n, surface, patches))
    off = field.deviations(patches.member[field.active]).reshape(patches.bins.rows, patches.bins.cols)
    each = field.root @ patches.levers[:, field.active].reshape(-1, 6).astype(field.root.dtype)
    return Sums(
        field, patches.over_bins(field.forces_n), off, field.forces_n.reshape(-1) @ patches.levers.reshape(-1, 6),
        (each.T @ each).astype(float), numbers_of_contacts(field, patches),
    )  # fmt: skip


def _by_loops(found: Field, surface: Float32[np.ndarray, '2 near near'], patches: PatchGrid) -> Sums:
    """The same, compiled."""
    bins = patches.bins
    forces, on_bins, off, wrench, covariance, contacts = compiled_loops().sums(
        found.forces_n, found.active, found.root, surface, patches.centres_mm, patches.bin_of, patches.shape,
        patches.size_mm, bins.count,
    )  # fmt: skip
    field, shape = Field(forces, found.active, found.root, found.misfit, found.gain), (bins.rows, bins.cols)
    return Sums(field, on_bins.reshape(3, *shape), off.reshape(shape), wrench, covariance, contacts)


def about(x_mm: float, y_mm: float, patches: PatchGrid) -> Float[np.ndarray, ' patches']:
    """Weights of the patches around a place, with sum 1: the overlap of a patch-sized square at the place with each."""
    shares = [
        np.maximum(1 - np.abs(line - np.clip(at, line[0], line[-1])) / size, 0.0)
        for at, line, size in zip((x_mm, y_mm), patches.lines_mm, patches.size_mm, strict=True)
    ]
    return np.outer(shares[1], shares[0]).ravel()


def covariance_of_tips(contacts: tuple[Contact, ...], spread: FieldSpread) -> Float[np.ndarray, '6 6']:
    """Covariance of force and torque of tips. Force and place of each tip have independent errors. Its shear is
    reported as zero, with the best uncertainty of a field of that force."""
    covariance = np.zeros((6, 6))
    for each in contacts:
        x, y, sheared = each.x_mm, each.y_mm, spread.shear_n(spread.nominal[0], 0.0, each.force_n)
        # (-f, -y f, x f): errors from the force, and from the place.
        by_force = np.array([0.0, 0.0, -1.0, -y, x, 0.0]) * each.sigma_n
        by_place = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0]) * each.force_n * each.sigma_mm
        along_x = np.array([1.0, 0.0, 0.0, 0.0, 0.0, -y]) * sheared
        along_y = np.array([0.0, 1.0, 0.0, 0.0, 0.0, x]) * sheared
        covariance += sum(np.outer(way, way) for way in (by_force, along_x, along_y)) + np.diag(np.square(by_place))
    return covariance
