"""What was found of a picture beside a description, in words."""

from __future__ import annotations

from dataclasses import dataclass

OK, LOOK, BAD = 'ok', 'look', 'bad'
"""Fine; works, but look at it; nothing useful can be measured like this."""


@dataclass(frozen=True)
class Finding:
    """What was looked at, how it is (`OK`, `LOOK`, `BAD`), and that in a sentence."""

    what: str
    level: str
    text: str


def percent(share: float) -> str:
    """'2.5 %' and '40 %'."""
    return f'{100 * share:.1f} %' if 0 < share < 0.1 else f'{100 * share:.0f} %'


def tone(dark: bool) -> str:
    """Of dots and markers beside what is around them."""
    return 'dark' if dark else 'bright'
