"""Axis settings reported by Marlin: steps, largest speeds, accelerations (marlinfw.org/docs/gcode/M503).

``M503`` reports all of them, in the same format in Marlin 1 and 2, with or without ``echo:``. A Marlin compiled with
DISABLE_M503 reports them one by one since 2.0.9, and before that not at all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from tactile_nodes.drivers.cnc.contract import Place

NUMBER = r'-?\d{1,6}(?:\.\d*)?'
QUESTIONS = ('M503', 'M92', 'M203', 'M201', 'M204')  # the first if supported, else the others


@dataclass(frozen=True)
class AxisSettings:
    """Settings of x, y and z; None: not reported.

    Attributes:
        steps_per_mm: of each (M92).
        speeds: the largest of each, in mm/s (M203). The axis does not go faster, whatever feed is commanded.
        acceleration: of the slowest axis, for moves with and without extrusion, in mm/s² (M201, M204).
    """

    steps_per_mm: Place | None = None
    speeds: Place | None = None
    acceleration: float | None = None

    @property
    def tells_times(self) -> bool:
        """Whether the duration of a move is known."""
        return self.speeds is not None and self.acceleration is not None

    def steps(self, way: Place) -> int | None:
        """Steps of the axis with the most on a way; None: unknown."""
        if self.steps_per_mm is None:
            return None
        return max(round(abs(mm) * each) for mm, each in zip(way, self.steps_per_mm, strict=True))

    def speed(self, way: Place, length: float, speed: float) -> float:
        """Speed of the tip along a way of that length, for a commanded speed, limited by the speed of each axis."""
        if self.speeds is None:
            return speed
        shares = [abs(mm) / length for mm in way] if length else []
        return min([speed, *(most / share for most, share in zip(self.speeds, shares, strict=bool(shares)) if share)])


def axis_settings(lines: list[str]) -> AxisSettings:
    """From the responses to `QUESTIONS`; empty if there are none."""
    most = _axes('M201', lines)
    match = next((found for line in lines if (found := re.search(rf'M204 P({NUMBER}).* T({NUMBER})', line))), None)
    accelerations = [*(most or ()), *((float(each) for each in match.groups()) if match else ())]
    slowest = min(accelerations) if most and match else 0.0
    return AxisSettings(_axes('M92', lines), _axes('M203', lines), slowest or None)


def _axes(code: str, lines: list[str]) -> Place | None:
    """X, Y, Z in ``M92 X80.00 Y80.00 Z400.00 E500.00``; None: not reported, or one is zero."""
    found = (re.search(rf'{code} X({NUMBER}) Y({NUMBER}) Z({NUMBER})', line) for line in lines)
    match = next((each for each in found if each is not None), None)
    if match is None:
        return None
    x, y, z = (float(each) for each in match.groups())
    return (x, y, z) if min(x, y, z) > 0 else None
