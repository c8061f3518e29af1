"""Questions about a sensor. Each can be answered by a flag and has a usual value in case the answer is unknown."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_nodes.cli.running.session import positive_float

if TYPE_CHECKING:
    from tactile_nodes.sensing.inspection.describing import Answers, Understood
    from tactile_nodes.sensors import CameraDescription

FOUND = 'found in the picture'
OF_PICTURE = (
    'pattern.kind', 'pattern.count', 'pattern.diameter_mm', 'pattern.pitch_mm', 'pattern.dark', 'pattern.dot_mm',
    'mask.polygons_px',
)  # fmt: skip
OF_CALIBRATION = 'focal_px', 'focal_px_per_rad', 'focal_ratio', 'distortion', 'centre_px'


@dataclass(frozen=True)
class Question:
    """A question: its flag, how answers are parsed, the usual value, and the entries that follow from it."""

    flag: str
    text: str
    read: Callable[[str], Any]
    usual: Any
    entries: tuple[str, ...]


def depths(text: str) -> tuple[float, float]:
    """The depths of a pattern: '0.3' is a layer of 0.1 mm at that depth, '1.5-6' is everything between the two."""
    low, _, high = text.partition('-')
    top = positive_float(low)
    bottom = positive_float(high) if high else top + 0.1
    if bottom <= top:
        raise argparse.ArgumentTypeError(f'{text!r} is not in order: write the smaller depth first, e.g. 1.5-6')
    return top, bottom


def modulus(text: str) -> float:
    """Shear modulus (MPa), as a number or as Shore A: a third of Young's modulus by Gent (1958); '10A' is 0.138."""
    if not text.upper().endswith('A'):
        return positive_float(text)
    shore = positive_float(text[:-1])
    if shore > 90:
        raise argparse.ArgumentTypeError(f'{text!r} is harder than any gel; Shore A from 1 to 90')
    return 0.0981 * (56 + 7.62336 * shore) / (0.137505 * (254 - 2.54 * shore)) / 3


def size(text: str) -> tuple[int, int]:
    """Width and height: '640x480'."""
    found = re.fullmatch(r'(\d{2,5})x(\d{2,5})', text)
    if not found:
        raise argparse.ArgumentTypeError(f'{text!r} is not a size; write width and height, e.g. 640x480')
    return int(found[1]), int(found[2])


def sides(text: str) -> str:
    """What is at the sides of a gel."""
    from tactile_nodes.sensors import SIDES as KNOWN

    if text not in KNOWN:
        raise argparse.ArgumentTypeError(f'{text!r} is none of: {", ".join(KNOWN)}')
    return text


WIDTH = Question(
    'width', 'How wide is the whole picture at the surface of the gel, from its left to its right edge [mm]?',
    positive_float, 0.0, ('gel.width_mm', 'gel.height_mm'),
)  # fmt: skip
PITCH = Question(
    'pitch', 'How far is it from one dot to the next [mm] (empty: you are asked for the visible width)?',
    lambda text: positive_float(text) if text else 0.0, 0.0, WIDTH.entries,
)  # fmt: skip
THICKNESS = Question(
    'thickness', 'How thick is the gel, down to what it is glued to [mm]?', positive_float, 4.0, ('gel.layers_mm',)
)
DOTS_DEPTH, TEXTURE_DEPTH = (
    Question('depth', 'How deep below the surface is the pattern [mm], e.g. 0.3 or 1.5-6?', depths, usual, entries)
    for usual, entries in (((0.3, 0.4), ('gel.markers_mm',)), ((0.2, 0.5), ('gel.markers_mm',)))
)
STIFFNESS = Question(
    'stiffness', 'How stiff is the gel: shear modulus [MPa], or Shore A, e.g. 10A?', modulus, 0.1, ('gel.moduli_mpa',)
)
SIDES = Question(
    'sides', 'What is at the sides of the gel: free, held (by a rigid frame), or ignored if you do not know?',
    sides, 'ignored', ('gel.sides',),
)  # fmt: skip
DATA_SHEET_OFF = 0.3
"""Relative uncertainty of a modulus that follows from a hardness or a data sheet."""
DISTANCE = Question(
    'distance', 'How far is the lens from the surface of the gel [mm]?', positive_float, 20.0,
    ('camera.position_mm',),
)  # fmt: skip


def answered(
    arguments: argparse.Namespace, seen: Understood, size_px: tuple[int, int]
) -> tuple[Answers, dict[str, str]]:
    """The values from flags and answers, and the source of each entry of the description.

    Raises:
        ConfigurationError: the calibration cannot be used, or the input ends before all questions are answered.
    """
    from tactile_nodes.sensing.inspection.describing import Answers

    asking = _Asking(arguments)
    camera = _calibrated(arguments, size_px)
    placed = camera is not None and arguments.distance is not None
    width, pitch = _lengths(asking, arguments, dots=seen.dots is not None, needed=not placed)
    given = {each.flag: asking.of(each) for each in (THICKNESS, STIFFNESS)}
    at_sides = asking.of(SIDES) if arguments.sides or seen.shows_rim else SIDES.usual
    markers = asking.of(TEXTURE_DEPTH if seen.dots is None else DOTS_DEPTH)
    distance = (arguments.distance or 0.0) if camera else asking.of(DISTANCE)
    sources = {**asking.sources, **dict.fromkeys(OF_PICTURE, FOUND), 'gel.poisson_ratios': 'assumed'}
    sources['camera.focal_px'] = 'from width and distance'
    if camera:
        sources |= dict.fromkeys((f'camera.{each}' for each in OF_CALIBRATION), f'from {arguments.camera_info}')
        sources['camera.position_mm'] = 'from calibration and width' if width or pitch else 'as given'
    if arguments.mask:
        sources['mask.polygons_px'] = 'as given'
    length = 'width' if width else 'pitch' if pitch else 'distance'
    sources |= dict.fromkeys(WIDTH.entries, f'from the picture and the {length} given')
    known = sources['gel.moduli_mpa'] != 'assumed'
    sources['gel.moduli_off'] = 'from a hardness or a data sheet' if known else 'not measured'
    answers = Answers(
        arguments.output.stem, width, pitch, given['thickness'], given['stiffness'],
        DATA_SHEET_OFF if known else Answers.modulus_off, markers, distance, camera, at_sides,
    )  # fmt: skip
    return answers, sources


def _lengths(asking: _Asking, arguments: argparse.Namespace, *, dots: bool, needed: bool) -> tuple[float, float]:
    """Visible width and pitch (mm); one of them is enough. If dots are visible, the pitch is asked for first."""
    pitch = arguments.pitch or 0.0
    if not needed:
        return arguments.width or 0.0, pitch
    if dots and asking.asks and not (pitch or arguments.width):
        pitch = asking.of(PITCH)
    return (0.0 if pitch and not arguments.width else asking.of(WIDTH)), pitch


class _Asking:
    """Takes the values of flags, asks for the others, and records the source of each value."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._given = arguments
        self.asks = sys.stdin.isatty() and not arguments.yes
        self.sources: dict[str, str] = {}

    def of(self, question: Question) -> Any:
        from tactile_nodes.errors import ConfigurationError

        given = getattr(self._given, question.flag)
        value = given if given is not None else self._answer_to(question) if self.asks else None
        if value is None and not question.usual:
            others = ', or of dots --pitch, or --camera-info and --distance' if question is WIDTH else ''
            raise ConfigurationError(f'{question.text} No picture shows this; give it with --{question.flag}{others}')
        source = 'assumed' if value is None else 'as given'
        self.sources |= dict.fromkeys(question.entries, source)
        return question.usual if value is None else value

    def _answer_to(self, question: Question) -> Any:
        """The answer to a question; None if it is not known."""
        from tactile_nodes.errors import ConfigurationError

        usual = f' (empty: {_as_text(question.usual)})' if question.usual else ''
        while True:
            try:
                text = input(f'{question.text}{usual} ').strip()
            except EOFError as error:
                raise ConfigurationError(
                    f'the input ended before the question was answered; answer with --{question.flag}'
                ) from error
            if not text and question.usual:
                return None
            try:
                return question.read(text)
            except argparse.ArgumentTypeError as error:
                print(error)


def _as_text(value: Any) -> str:
    each = value if isinstance(value, tuple) else (value,)
    return '-'.join(one if isinstance(one, str) else f'{one:g}' for one in each)


def _calibrated(arguments: argparse.Namespace, size_px: tuple[int, int]) -> CameraDescription | None:
    """The camera according to a calibration.

    Raises:
        ConfigurationError: the calibration is for another picture size, or --fisheye is given without a calibration.
    """
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.params import from_mapping
    from tactile_nodes.sensors import CameraDescription
    from tactile_nodes.sensors.camera_file import read_camera_file

    file: Path | None = arguments.camera_info
    if file is None and arguments.fisheye:
        raise ConfigurationError('--fisheye is the lens model of a calibration: give its file with --camera-info')
    if file is None:
        return None
    fields = read_camera_file(file, 'fisheye' if arguments.fisheye else '')
    of = fields.pop('image.width', size_px[0]), fields.pop('image.height', size_px[1])
    if of != size_px:
        raise ConfigurationError(
            f'{file} was calibrated with pictures of {of[0]}x{of[1]}, but these have {size_px[0]}x{size_px[1]}; '
            'calibrate at the size in use'
        )
    values = {name.removeprefix('camera.'): value for name, value in fields.items()}
    return from_mapping(CameraDescription, values, source=str(file), exact=False)
