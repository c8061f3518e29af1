"""Findings of an inspection, as text."""

from __future__ import annotations

from dataclasses import dataclass

OK, LOOK, BAD = 'ok', 'look', 'bad'
"""Fine; works, but check it; no useful measurement is possible."""


@dataclass(frozen=True)
class Finding:
    """What was checked, its level (`OK`, `LOOK`, `BAD`), and a sentence about it."""

    subject: str
    level: str
    text: str


def percent(share: float) -> str:
    """'2.5 %' and '40 %'."""
    return f'{100 * share:.1f} %' if 0 < share < 0.1 else f'{100 * share:.0f} %'


def tone(dark: bool) -> str:
    """Tone of dots and markers relative to their surroundings."""
    return 'dark' if dark else 'bright'
