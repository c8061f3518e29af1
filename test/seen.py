"""What one sees of a sensor, as messages made by hand and received at given times."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus.protocol import Received
from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.sensing.explain.reading import Acting, Contact, Region, SurfaceField
from tactile_nodes.sensing.geometry import BinGrid

MS = 1_000_000
S = 1_000_000_000
NAN = math.nan

# A force field made by hand: a ring that presses, is dragged along x and turned.
CELLS = 36
BINS = BinGrid(9, 9, 36.0, 36.0)  # cells of 1 mm, four a bin along each side
RADIUS_MM, RIM_MM = 5.0, 0.8
TOTAL_N, DRAG, TURN_N_MM = 2.0, 0.3, 4.0
PLACE_MM = (4.0, -3.0)
SHEAR_SIGMA_N, TORSION_SIGMA_N_MM = 0.02, 0.1


def force(
    stamp_ms: float, bins: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), contact_mm: tuple[float, float] | None = None, **kw
) -> types.ForceDistribution:
    """A 2 x 2 force distribution; its total is the sum."""
    x, y = contact_mm or (NAN, NAN)
    return types.ForceDistribution(
        header=types.Header(stamp=time_from_ns(round(stamp_ms * MS))),
        rows=2,
        cols=2,
        normal_force=np.array(bins, np.float32),
        total=float(sum(bins)),
        in_contact=contact_mm is not None,
        contact=types.Point(x=x / 1000, y=y / 1000, z=0.0),
        **kw,
    )


def received(message: object, arrival_ms: float = 0.0, sequence: int = 1, publisher: str = 'a.1') -> Received:
    arrival_ns = round(arrival_ms * MS)
    return Received(message.__msgtype__, publisher, sequence, arrival_ns, arrival_ns, message=message)


def diagnostics(*parts: tuple[str, int, str]) -> types.DiagnosticArray:
    return types.DiagnosticArray(
        status=[types.DiagnosticStatus(name=name, level=level, message=text) for name, level, text in parts]
    )


def log(level: int, name: str, text: str) -> types.Log:
    return types.Log(level=level, name=name, msg=text)


def ring_acting() -> tuple[np.ndarray, Acting, Contact]:
    """Forces on the bins, all that acts, and the contact: 2 N, 0.6 N of shear along x, 4 N mm from x towards y."""
    middle = np.arange(CELLS) + 0.5 - CELLS / 2
    x, y = np.meshgrid(middle, middle)
    right, down = x - PLACE_MM[0], y - PLACE_MM[1]
    away = np.hypot(right, down)
    press = np.exp(-(((away - RADIUS_MM) / RIM_MM) ** 2))
    press *= TOTAL_N / press.sum()  # N on each cell of 1 mm², so MPa as well
    around = np.stack([-down, right], axis=-1) * (press / away)[..., None]
    torsion = float((right * around[..., 1] - down * around[..., 0]).sum())
    shear = np.stack([DRAG * press, np.zeros_like(press)], axis=-1) + around * TURN_N_MM / torsion
    forces, shear_n = _over_bins(press), _over_bins(shear)
    known = np.full_like(press, 1e-3, np.float32)
    field = SurfaceField(press.astype(np.float32), shear.astype(np.float32), known, known)
    pull_x, pull_y = shear.sum(axis=(0, 1)).tolist()
    turn = TURN_N_MM + PLACE_MM[0] * pull_y - PLACE_MM[1] * pull_x
    acting = Acting(
        explanation='field',
        shear_n=shear_n,
        normal_sigma_n=np.full((9, 9), 0.01, np.float32),
        wrench=np.array([pull_x, pull_y, -TOTAL_N, -PLACE_MM[1] * TOTAL_N, PLACE_MM[0] * TOTAL_N, turn]),
        wrench_covariance=np.diag([SHEAR_SIGMA_N, SHEAR_SIGMA_N, 0.01, 0.0, 0.0, TORSION_SIGMA_N_MM]) ** 2,
        field=field,
    )
    region = Region(
        (pull_x, pull_y), SHEAR_SIGMA_N, TURN_N_MM, TORSION_SIGMA_N_MM, 40.8, 11.3, 11.3, 0.0, 0.2,
    )  # fmt: skip
    return forces, acting, Contact(*PLACE_MM, TOTAL_N, 0.05, 0.01, region=region)


def ring(stamp_ns: int, status: int = 0) -> tuple[types.ForceDistribution, types.ForceField]:
    """Both messages, made as the force estimator makes them."""
    forces, acting, contact = ring_acting()
    fields = conversions.force_fields(forces, BINS, (contact,), total_sigma_n=0.01, unlikeness=0.2, acting=acting)
    force = types.ForceDistribution(header=conversions.header(stamp_ns, 'gel_surface'), status=status, **fields)
    assert acting.field is not None
    return force, conversions.field_message(acting.field, BINS, force)


def _over_bins(cells: np.ndarray) -> np.ndarray:
    side = CELLS // 9
    blocks: np.ndarray = cells.reshape(9, side, 9, side, *cells.shape[2:]).sum(axis=(1, 3)).astype(np.float32)
    return blocks


def taken_apart(message: bytes) -> tuple[dict[str, Any], dict[str, bytes], list[tuple[float, float, float]]]:
    """A message to the page, as the page decodes it: JSON, sections, samples (`web.packet`)."""
    (length,) = struct.unpack_from('<I', message)
    place = 4 + length
    fields = json.loads(message[4:place])
    sections = {}
    for name, size in fields.pop('sections'):
        sections[name] = message[place : place + size]
        place += size
    return fields, sections, list(struct.iter_unpack('<dff', message[place:]))
