"""The disturbances of the stability benchmark, each from a hardly visible to a far too strong level."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks import disturbances as disturb
from benchmarks.stability.stream import (
    Change,
    ForceTables,
    Moment,
    Presses,
    always,
    force_n,
    from_the_third_press,
    in_the_rest_image,
)
from benchmarks.stability.times import TIMES, caught_once, pressed_slowly
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.sensing.flow.patches import moved_image
from tactile_nodes.sensing.picture.quality import FAINT_LIGHT
from tactile_nodes.simulation.camera import through_jpeg
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press, mix

DARK_START = (0.70, 0.97, 0.99)
"""Light in the first frames of real cameras that adjust their exposure (the GelSight videos begin like this)."""


@dataclass(frozen=True)
class Case:
    """A disturbance with rising levels.

    `held_at` are the levels at which force errors must stay within 1.5 times the undisturbed ones.
    """

    family: str
    name: str
    unit: str
    levels: tuple[float, ...]
    change: Callable[[float], Change]
    held_at: tuple[float, ...] = ()

    @property
    def key(self) -> str:
        """Its unique name."""
        return f'{self.family} {self.name} {self.unit}'

    def at(self, level: float) -> Change:
        """The change at a level."""
        return self.change(float(level))


def _gel(name: str, unit: str, levels: tuple[float, ...], gel: Callable[..., Gel], *held: float) -> Case:
    return Case('geometry', name, unit, levels, lambda level: Change(gel=partial(_called, gel, level)), held)


def _called(change: Callable[..., Gel], level: float, gel: Gel) -> Gel:
    return change(gel, level)


def _light(name: str, unit: str, levels: tuple[float, ...], light: Callable[..., np.ndarray], *held: float) -> Case:
    return Case('light', name, unit, levels, lambda level: Change(light=lambda of, at: light(of, at, level)), held)


def _optics(name: str, unit: str, levels: tuple[float, ...], light: Callable[..., np.ndarray], *held: float) -> Case:
    return dataclasses.replace(_light(name, unit, levels, light, *held), family='optics')


def _picture(name: str, unit: str, levels: tuple[float, ...], picture: Callable[..., np.ndarray]) -> Case:
    return Case('optics', name, unit, levels, lambda level: Change(picture=lambda of, at: picture(of, at, level)))


def _gone(name: str, levels: tuple[float, ...], gone: Callable[..., np.ndarray], *held: float) -> Case:
    return Case(
        'pattern', name, '% gone', levels, lambda level: Change(gone=lambda markers: gone(markers, level / 100)), held
    )


def _during(moment: Moment, share: float) -> float:
    """The present part of a slow change; it is complete after two thirds of the presses."""
    return share * min(1.0, max(0, moment.number - 20) / 170)


def _faded(moment: Moment, percent: float) -> float:
    return 1 - _during(moment, percent / 100)


def _given_way(light: np.ndarray, moment: Moment, px_per_n: float) -> np.ndarray:
    """The light in a camera that moves along the diagonal with the force, as on a mounting that is not stiff."""
    moved_px = px_per_n * force_n(moment, {'tip': contact_table(Gel())}) / math.sqrt(2)
    return moved_image(light, moved_px, moved_px) if moved_px else light


LIGHT = (
    _light('brightness', 'x', (0.7, 0.5, 1.3, 1.5), lambda light, _, level: light * level,
           0.7, 1.3),
    _light('gradient', '% at the edges', (20, 90), lambda light, _, level: disturb.graded(light, level / 100)),
    _light('flicker', '%', (10, 30),
           lambda light, at, level: light * np.float32(1 + level / 100 * math.sin(2.3 * at.number))),
    Case('light', 'fading LED', '% at the end', (50, 90),
         lambda level: Change(light=lambda light, at: light * np.float32(_faded(at, level)),
                              beyond=lambda at: _faded(at, level) < FAINT_LIGHT)),
    _light('hot spot', 'grey', (20, 100, 400), lambda light, _, level: disturb.with_hot_spot(light, level)),
)  # fmt: skip

OPTICS = (
    _optics('blur', 'px', (0.5, 1, 3), lambda light, _, level: disturb.blurred(light, level), 0.5, 1),
    _optics('dirt on the lens', '% covered', (1, 10, 30),
            lambda light, _, level: light * disturb.dirt(light.shape, level / 100)),
    Case('optics', 'noise', 'x', (4, 8), lambda level: Change(noise=level), (4,)),
    _optics('rolling bands', 'grey', (3, 30), lambda light, at, level: disturb.banded(light, level, at.number)),
    _picture('JPEG', 'quality', (90, 30), lambda image, _, level: through_jpeg(image, round(level))),
    _picture('lost pixels', '%', (0.1, 5), lambda image, _, level: disturb.stuck_pixels(image, level / 100, 0)),
    _picture('stuck pixels', '%', (0.1, 5), lambda image, _, level: disturb.stuck_pixels(image, level / 100, 255)),
)  # fmt: skip

GEOMETRY = (
    _gel('camera shifted', 'px', (0.3, 1, 3, 5), disturb.knocked, 0.3, 1, 3),
    Case('geometry', 'camera shifted as a tip comes down', 'px', (0.3, 3),
         lambda level: Change(gel=lambda gel: disturb.knocked(gel, level), acts=from_the_third_press)),
    Case('geometry', 'camera gives way under the force', 'px per N', (0.03, 0.1, 0.3),
         lambda level: Change(light=lambda light, at: _given_way(light, at, level))),
    _gel('camera turned', 'degrees', (0.1, 1, 2), disturb.rolled, 0.1, 1),
    _gel('magnified', '%', (0.2, 1), disturb.magnified),
    _gel('gel swollen', 'mm', (0.1, 0.3), lambda gel, mm: disturb.shrunk(gel, -100 * mm / gel.soft_mm)),
    _gel('gel re-seated', 'mm', (0.1, 1), disturb.reseated),
    Case('geometry', 'gel re-seated, rest image anew', 'mm', (0.3, 2),
         lambda level: Change(gel=lambda gel: disturb.reseated(gel, level), acts=always)),
    _gel('another gel put in', '', (1,), lambda gel, number: disturb.other_markers(gel, round(number))),
)  # fmt: skip

PATTERN = (
    _gone('markers gone', (10, 20, 40, 80), disturb.gone_anywhere, 10, 20),
    _gone('markers gone in clusters', (5, 50), disturb.gone_in_clusters),
    _gone('no markers in a corner', (5, 30), disturb.gone_in_a_corner),
)


def _each(change: Callable[[Press, int, ForceTables], Presses]) -> Callable[..., list[Presses]]:
    """Replace every press of the usual stream."""
    return lambda presses, tables: [change(each[0], number, tables) for number, each in enumerate(presses)]


def _pressing(name: str, unit: str, levels: tuple[float, ...], change: Callable[..., Presses], family: str) -> Case:
    return Case(
        family, name, unit, levels,
        lambda level: Change(presses=_each(lambda *given: change(*given, level)), contact=True),
    )  # fmt: skip


def _deep(press: Press, number: int, _: ForceTables, depth_mm: float) -> Presses:
    return (dataclasses.replace(press, depth_mm=depth_mm - 0.01 * (number % 4)),)


def _dragged(press: Press, number: int, _: ForceTables, drag_mm: float) -> Presses:
    angle = 2 * math.pi * mix(number) / 2**64
    return (dataclasses.replace(press, shift_mm=(drag_mm * math.cos(angle), drag_mm * math.sin(angle))),)


def _dragged_right(press: Press, _number: int, _: ForceTables, drag_mm: float) -> Presses:
    return (dataclasses.replace(press, shift_mm=(drag_mm, 0.0)),)


def _several(press: Press, number: int, _: ForceTables, apart_mm: float, count: int) -> Presses:
    """Some contacts on a circle around the middle of the gel, `apart_mm` from each other."""
    radius_mm, turn = apart_mm / 2 / math.sin(math.pi / count), 2 * math.pi * mix(number) / 2**64
    angles = [turn + 2 * math.pi * each / count for each in range(count)]
    depths = [press.depth_mm * (1, 0.8, 0.9)[each] for each in range(count)]
    x_mm, y_mm = press.x_mm / 3, press.y_mm / 3
    return tuple(
        Press(x_mm + radius_mm * math.cos(angle), y_mm + radius_mm * math.sin(angle), depth)
        for angle, depth in zip(angles, depths, strict=True)
    )


def _body(name: str) -> Callable[..., Presses]:
    def press_with(press: Press, _: int, tables: ForceTables, most_n: float) -> Presses:
        depth_mm = tables[name].depth_at(min(most_n, 2.0) * press.depth_mm / 1.9)
        return (dataclasses.replace(press, indenter=name, depth_mm=depth_mm),)

    return press_with


def _at_the_edge(press: Press, number: int, _: ForceTables, from_middle_mm: float) -> Presses:
    side = from_middle_mm if number % 2 else -from_middle_mm
    if number // 2 % 2:
        return (dataclasses.replace(press, y_mm=side),)
    return (dataclasses.replace(press, x_mm=side),)


def _in_the_corner(press: Press, number: int, _: ForceTables, from_middle_mm: float) -> Presses:
    x, y = ((1, 1), (1, -1), (-1, 1), (-1, -1))[number % 4]
    return (dataclasses.replace(press, x_mm=x * from_middle_mm, y_mm=y * from_middle_mm),)


def _shaken(light: np.ndarray, at: Moment, size_px: float) -> np.ndarray:
    angle = 2 * math.pi * mix(at.number) / 2**64
    return moved_image(light, size_px * math.cos(angle), size_px * math.sin(angle))


MOTION = (
    _pressing('deeper than trained', 'mm', (2.0, 2.2, 2.5), _deep, 'motion'),
    Case('motion', 'pressed fast, 8 ms exposure', 'mm/s', (10, 100),
         lambda level: Change(speed_mm_s=level, contact=True, course=lambda moments: caught_once(moments, level))),
    Case('motion', 'pressed slowly, noise 4x', 'mm/s', (0.05, 0.2, 0.8),
         lambda level: Change(noise=4, speed_mm_s=level, course=lambda moments: pressed_slowly(moments, level))),
    _pressing('dragged', 'mm', (0.1, 0.3, 1), _dragged, 'motion'),
    Case('motion', 'vibration', 'px', (0.05, 0.3, 1.5),
         lambda level: Change(light=lambda light, at: _shaken(light, at, level))),
)  # fmt: skip

CONTACT = (
    _pressing('two contacts', 'mm apart', (14, 7, 4), partial(_several, count=2), 'contact'),
    _pressing('three contacts', 'mm apart', (12, 7), partial(_several, count=3), 'contact'),
    _pressing('ball of 6 mm', 'N at most', (0.2, 1), _body('ball'), 'contact'),
    _pressing('flat punch of 3 mm', 'N at most', (0.2, 1), _body('punch'), 'contact'),
    _pressing('at the edge', 'mm from the middle', (13, 14.5, 15.5), _at_the_edge, 'contact'),
    _pressing('in the corners', 'mm from both middles', (13.5, 14.5, 15.5), _in_the_corner, 'contact'),
)


def _touched(depth_mm: float, frames: int = 99) -> Change:
    press = (Press(4.0, -3.0, depth_mm),)
    return Change(capture=lambda number: press if number < frames else (), acts=in_the_rest_image)


def _dark(light: np.ndarray, at: Moment, level: float) -> np.ndarray:
    """Dark frames before the exposure is adjusted, as from many cameras; the last ones become brighter."""
    late = at.number - round(level)
    share = 0.0 if late < 0 else DARK_START[late] if late < len(DARK_START) else 1.0
    darker: np.ndarray = light * np.float32(share)
    return darker


REST_IMAGE = (
    Case('rest image', 'taken while touched', 'mm deep', (0.1, 0.3, 1), _touched),
    Case('rest image', 'touched in its first frames', 'of 16', (2, 8), lambda level: _touched(1.0, round(level))),
    Case('rest image', 'stale: the sensor warmed up since', 'min', (3, 60),
         lambda level: Change(gel=lambda gel: disturb.warmed(gel, level))),
    Case('rest image', 'of another gel', '', (1,),
         lambda level: Change(gel=lambda gel: disturb.other_markers(gel, round(level)), acts=in_the_rest_image)),
    Case('rest image', 'dark first frames', 'black frames', (0, 14),
         lambda level: Change(light=lambda light, at: _dark(light, at, level), acts=in_the_rest_image)),
    Case('rest image', 'captured at part of the light', 'x', (0.7, 0.5),
         lambda level: Change(light=lambda light, _: light * level, acts=in_the_rest_image)),
)  # fmt: skip


def _none(values: np.ndarray, share: float) -> np.ndarray:
    broken = np.array(values)
    broken[: max(1, round(share / 100 * len(broken)))] = np.nan
    return broken


def _frozen(moments: list[Moment]) -> list[Moment]:
    """Without contact the camera repeats one picture, including its noise; the rest image is the same picture."""
    return [each if each.touching else dataclasses.replace(each, number=moments[0].number) for each in moments]


NUMBERS = (
    Case('numbers', 'NaN among the features', '%', (0.1, 100),
         lambda level: Change(values=lambda values: _none(values, level))),
    Case('numbers', 'saturated', 'x light', (3, 20), lambda level: Change(light=lambda light, _: light * level)),
    Case('numbers', 'all black', '', (0,), lambda _: Change(picture=lambda image, _: np.zeros_like(image))),
    Case('numbers', 'all white', '', (255,), lambda _: Change(picture=lambda image, _: np.full_like(image, 255))),
    _pressing('motion at the wrap of the angle', 'mm dragged right', (0.2,), _dragged_right, 'numbers'),
    Case('numbers', 'motion exactly zero', '', (0,), lambda _: Change(course=_frozen)),
)  # fmt: skip

CASES: tuple[Case, ...] = (
    *LIGHT, *OPTICS, *GEOMETRY, *PATTERN, *MOTION, *CONTACT,
    *(Case('time', name, unit, levels, change) for name, unit, levels, change in TIMES),
    *REST_IMAGE, *NUMBERS,
)  # fmt: skip


def named(text: str, cases: Sequence[Case] = CASES) -> list[Case]:
    """Cases whose name contains a text, or whose family is that text."""
    return [each for each in cases if text.lower() in each.name.lower() or text.lower() == each.family]
