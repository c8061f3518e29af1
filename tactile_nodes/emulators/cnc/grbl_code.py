"""Parses G-code lines as Grbl does: words, modal groups, and the error number of each mistake.

Words that no driver sends, as those of arcs and probing, are refused (error 20).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

MM_PER_INCH = 25.4
AXES = 'XYZ'
MOTIONS = {0.0: 'G0', 1.0: 'G1', 80.0: 'G80'}
NON_MODAL = {4.0, 53.0}
GROUPS: dict[float, str] = {
    **{float(number): 'plane' for number in (17, 18, 19)},
    **{float(number): 'units' for number in (20, 21)},
    **{float(number): 'distance' for number in (90, 91)},
    **{float(number): 'system' for number in range(54, 60)},
    94.0: 'feed_mode', 40.0: 'cutter', 49.0: 'tool_length', 61.0: 'path',
}  # fmt: skip
JOG_CODES = {20.0, 21.0, 53.0, 90.0, 91.0}
WORD = re.compile(r'([A-Z])([-+]?\d*\.?\d*)')


class GrblError(Exception):
    """A mistake in a line; `number` is sent after ``error:``."""

    def __init__(self, number: int) -> None:
        super().__init__(f'error:{number}')
        self.number = number


@dataclass(frozen=True)
class Modal:
    """The modal state, which lines change; the defaults are those after a reset."""

    motion: str = 'G0'
    system: int = 54
    plane: int = 17
    units: int = 21
    distance: int = 90
    coolant: int = 9
    feed: float = 0.0


@dataclass(frozen=True)
class Command:
    """One parsed line. Axes and feed are in mm."""

    modal: Modal
    motion: str | None = None
    axes: dict[int, float] = field(default_factory=dict)
    non_modal: float | None = None
    values: dict[str, float] = field(default_factory=dict)
    coolant: bool = False


def words_of(text: str) -> list[tuple[str, float]]:
    """The words of a line without spaces and comments."""
    words, place = [], 0
    while place < len(text):
        match = WORD.match(text, place)
        if match is None:
            raise GrblError(1)
        if not re.search(r'\d', match.group(2)):
            raise GrblError(2)
        words.append((match.group(1), float(match.group(2))))
        place = match.end()
    return words


def understand(text: str, modal: Modal) -> Command:
    """The command in a G-code line.

    Raises:
        GrblError: with Grbl's number.
    """
    codes, values = _sorted_words(words_of(text))
    chosen: dict[str, float] = {}
    for letter, number in codes:
        group = _group(letter, number)
        if group in chosen:
            raise GrblError(21)
        chosen[group] = number
    return _command(chosen, values, modal)


def understand_jog(text: str, modal: Modal) -> Command:
    """The command after ``$J=``, which does not change the modal state."""
    codes, values = _sorted_words(words_of(text))
    if any(letter != 'G' or number not in JOG_CODES for letter, number in codes):
        raise GrblError(16)
    chosen = {_group(letter, number): number for letter, number in codes}
    units = chosen.get('units', float(modal.units))
    axes = _axes(values, units)
    if not axes:
        raise GrblError(26)
    if values.get('F', 0.0) <= 0:
        raise GrblError(22)
    mode = replace(modal, distance=int(chosen.get('distance', modal.distance)), feed=values['F'] * _factor(units))
    return Command(mode, 'G1', axes, chosen.get('non_modal'))


def _sorted_words(words: list[tuple[str, float]]) -> tuple[list[tuple[str, float]], dict[str, float]]:
    codes = [(letter, number) for letter, number in words if letter in 'GM']
    values: dict[str, float] = {}
    for letter, number in words:
        if letter in 'GM':
            continue
        if letter not in 'XYZFSPLNTR':
            raise GrblError(20)
        if letter in values:
            raise GrblError(25)
        values[letter] = number
    return codes, values


def _group(letter: str, number: float) -> str:
    if letter == 'M':
        if number not in {8.0, 9.0}:
            raise GrblError(20)
        return 'coolant'
    if number in MOTIONS:
        return 'motion'
    if number in NON_MODAL:
        return 'non_modal'
    if number not in GROUPS:
        raise GrblError(20)
    return GROUPS[number]


def _command(chosen: dict[str, float], values: dict[str, float], modal: Modal) -> Command:
    units = chosen.get('units', float(modal.units))
    axes, non_modal = _axes(values, units), chosen.get('non_modal')
    new = _new_modal(chosen, values, modal, units)
    motion = new.motion if axes or chosen.get('motion', 80.0) != 80.0 else None
    _check_motion(motion, new, non_modal, values)
    return Command(new, motion, axes, non_modal, values, 'coolant' in chosen)


def _new_modal(chosen: dict[str, float], values: dict[str, float], modal: Modal, units: float) -> Modal:
    changes = {name: int(chosen[name]) for name in ('system', 'plane', 'distance', 'coolant') if name in chosen}
    feed = values['F'] * _factor(units) if 'F' in values else modal.feed
    motion = MOTIONS[chosen['motion']] if 'motion' in chosen else modal.motion
    return replace(modal, **changes, units=int(units), motion=motion, feed=feed)


def _check_motion(motion: str | None, modal: Modal, non_modal: float | None, values: dict[str, float]) -> None:
    if non_modal == 4.0 and 'P' not in values:
        raise GrblError(28)
    if non_modal == 53.0 and modal.motion == 'G80':
        raise GrblError(30)
    if motion is None:
        return
    if motion == 'G80':
        raise GrblError(31)
    if motion != 'G0' and modal.feed <= 0:
        raise GrblError(22)


def _axes(values: dict[str, float], units: float) -> dict[int, float]:
    return {AXES.index(letter): number * _factor(units) for letter, number in values.items() if letter in AXES}


def _factor(units: float) -> float:
    return MM_PER_INCH if units == 20.0 else 1.0
