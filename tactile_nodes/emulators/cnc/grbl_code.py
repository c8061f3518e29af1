"""Parses the lines of G-code that a driver sends, with Grbl's number for each mistake.

Each of these lines is complete, so no modal state is kept. Other codes are refused (error 20).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

MM_PER_INCH = 25.4
AXES = 'XYZ'
CODES = {'G1', 'G4', 'G17', 'G21', 'G53', 'G54', 'G90', 'G91', 'G94', 'M8', 'M9'}
JOG_CODES = {'G21', 'G53', 'G90', 'G91'}
WORD = re.compile(r'([A-Z])([-+]?\d*\.?\d*)')


class GrblError(Exception):
    """A mistake in a line; `number` is sent after ``error:``."""

    def __init__(self, number: int) -> None:
        super().__init__(f'error:{number}')
        self.number = number


@dataclass(frozen=True)
class Command:
    """One parsed line: its codes, and its other words, in mm and mm/min."""

    codes: frozenset[str]
    values: dict[str, float]

    @property
    def axes(self) -> dict[int, float]:
        """The coordinates, by the number of their axis."""
        return {AXES.index(letter): value for letter, value in self.values.items() if letter in AXES}

    @property
    def is_relative(self) -> bool:
        """Whether they are distances."""
        return 'G91' in self.codes and 'G53' not in self.codes

    @property
    def feed_mm_min(self) -> float:
        """The feed of a motion. Raises GrblError: there is none."""
        if self.values.get('F', 0.0) <= 0:
            raise GrblError(22)
        return self.values['F']


def understand(text: str) -> Command:
    """The command in a line without spaces and comments, in capitals.

    Raises:
        GrblError: with Grbl's number.
    """
    codes: set[str] = set()
    values: dict[str, float] = {}
    place = 0
    while place < len(text):
        match = WORD.match(text, place)
        if match is None:
            raise GrblError(1)
        letter, number = match.groups()
        if not re.search(r'\d', number):
            raise GrblError(2)
        if letter in 'GM':
            codes.add(f'{letter}{float(number):g}')
        elif letter not in 'XYZFP':
            raise GrblError(20)
        elif letter in values:
            raise GrblError(25)
        else:
            values[letter] = float(number)
        place = match.end()
    if codes - CODES:
        raise GrblError(20)
    return Command(frozenset(codes), values)


def understand_jog(text: str) -> Command:
    """The command after ``$J=``. Raises as `understand`."""
    command = understand(text)
    if command.codes - JOG_CODES:
        raise GrblError(16)
    if not command.axes:
        raise GrblError(26)
    return command
