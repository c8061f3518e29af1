"""What one sees of a sensor, as messages made by hand and received at given times."""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.bus.protocol import Received
from tactile_nodes.messages import time_from_ns, types

MS = 1_000_000
S = 1_000_000_000
NAN = math.nan


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
