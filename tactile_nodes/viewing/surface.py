"""A ForceField prepared for drawing: arrays of rows and columns, and the outlines of contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_nodes.errors import MessageError
from tactile_nodes.messages import types
from tactile_nodes.shapes import Float, Float32

KILO = 1e3
"""Pascals in a kilopascal."""


@dataclass(frozen=True)
class Surface:
    """Pressure and shear (kPa) on cells of the surface, in mm in its frame; `shear_kpa` is x and y of each cell."""

    pressure_kpa: Float32[np.ndarray, 'rows cols']
    shear_kpa: Float32[np.ndarray, 'rows cols 2']
    cell_mm: tuple[float, float]
    origin_mm: tuple[float, float]

    @property
    def centres_mm(self) -> tuple[Float[np.ndarray, ' cols'], Float[np.ndarray, ' rows']]:
        """x of each column and y of each row."""
        rows, cols = self.pressure_kpa.shape
        x, y = (
            start + size * (np.arange(count) + 0.5)
            for start, size, count in zip(self.origin_mm, self.cell_mm, (cols, rows), strict=True)
        )
        return x, y


def surface_of(field: Any) -> Surface | None:
    """The surface of a ForceField message; None if it is invalid or has no pressure. Unknown shear is zero.

    Raises:
        MessageError: its arrays do not fill its grid.
    """
    if field.status == types.ForceDistribution.STATUS_INVALID or not field.pressure.size:
        return None
    shape, size = (int(field.rows), int(field.cols)), int(field.rows * field.cols)
    if field.pressure.size != size or {field.shear_x.size, field.shear_y.size} - {0, size}:
        raise MessageError(f'a force field has {field.pressure.size} pressures, but a grid of {shape[0]} x {shape[1]}')
    has_shear = field.shear_x.size == field.shear_y.size == size
    parts = [
        part.reshape(shape) if has_shear else np.zeros(shape, np.float32) for part in (field.shear_x, field.shear_y)
    ]
    return Surface(
        pressure_kpa=field.pressure.reshape(shape) / np.float32(KILO),
        shear_kpa=np.stack(parts, axis=-1) / np.float32(KILO),
        cell_mm=(field.cell_width * KILO, field.cell_height * KILO),
        origin_mm=(field.origin.x * KILO, field.origin.y * KILO),
    )


def over_half(surface: Surface, contacts: Sequence[Any]) -> Float32[np.ndarray, 'rows cols']:
    """Pressure over half of the maximum of its contact: outlines of contacts are where it is 1.

    A cell belongs to the nearest contact (Contact messages). Without contacts, all is zero.
    """
    placed = [each for each in contacts if math.isfinite(each.position.x) and math.isfinite(each.position.y)]
    pressure = np.nan_to_num(surface.pressure_kpa)
    if not placed:
        return np.zeros_like(pressure)
    x, y = surface.centres_mm
    owner = np.argmin([_distance_mm(each, x[None], y[:, None]) for each in placed], axis=0)
    half = np.array([pressure[owner == number].max(initial=0.0) / 2 for number in range(len(placed))])
    lowest = np.finfo(np.float32).tiny
    shares: np.ndarray = (pressure / np.maximum(half, lowest)[owner]).astype(np.float32)
    return shares


def _distance_mm(contact: Any, x_mm: np.ndarray, y_mm: np.ndarray) -> Float[np.ndarray, 'rows cols']:
    """Distance from the rim of a bar with round ends (length, width and angle of the contact), or from its centre."""
    length, width, angle = (
        value if math.isfinite(value) else 0.0 for value in (contact.length * KILO, contact.width * KILO, contact.angle)
    )
    right, down = x_mm - contact.position.x * KILO, y_mm - contact.position.y * KILO
    along = right * math.cos(angle) + down * math.sin(angle)
    across = down * math.cos(angle) - right * math.sin(angle)
    reach = max(length - width, 0.0) / 2
    distance_mm: np.ndarray = np.hypot(along - np.clip(along, -reach, reach), across) - width / 2
    return distance_mm
