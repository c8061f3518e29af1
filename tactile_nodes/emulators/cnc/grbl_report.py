"""Grbl's status reports: which fields, in which order, how often."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.emulators.cnc.grbl_code import MM_PER_INCH
from tactile_nodes.emulators.motion import Vector


@dataclass(frozen=True)
class Snapshot:
    """The values that a report can contain."""

    state: str
    machine_mm: Vector
    blocks_free: int
    bytes_free: int
    feed_mm_min: float
    accessories: str
    busy: bool


class StatusReports:
    """Counts reports, because the slow fields come only with every tenth to thirtieth."""

    def __init__(self) -> None:
        self._until_offset = 0
        self._until_overrides = 0

    def text(self, now: Snapshot, mask: int, inches: bool) -> str:
        """One report, without its line end."""
        return '<' + '|'.join(self._fields(now, mask, inches)) + '>'

    def _fields(self, now: Snapshot, mask: int, inches: bool) -> list[str]:
        place = f'{"MPos" if mask & 1 else "WPos"}:{coordinates(now.machine_mm, inches)}'
        feed = now.feed_mm_min / (MM_PER_INCH if inches else 1)
        fields = [now.state, place]
        fields += [f'Bf:{now.blocks_free},{now.bytes_free}'] if mask & 2 else []
        fields += [f'FS:{feed:.0f},0']
        return fields + self._slow_fields(now, inches)

    def _slow_fields(self, now: Snapshot, inches: bool) -> list[str]:
        fields = []
        if self._until_offset > 0:
            self._until_offset -= 1
        else:
            self._until_offset = 29 if now.busy else 9
            self._until_overrides = self._until_overrides or 1  # not both in one report
            fields.append(f'WCO:{coordinates((0.0, 0.0, 0.0), inches)}')
        if self._until_overrides > 0:
            self._until_overrides -= 1
        else:
            self._until_overrides = 19 if now.busy else 9
            fields.append('Ov:100,100,100')
            fields += [f'A:{now.accessories}'] if now.accessories else []
        return fields


def coordinates(place_mm: Vector, inches: bool) -> str:
    """Three numbers as Grbl prints them: 0.6 mm is 0.0236 in inches."""
    if inches:
        return ','.join(f'{value / MM_PER_INCH:.4f}' for value in place_mm)
    return ','.join(f'{value:.3f}' for value in place_mm)
