"""A simulated stream of pictures with a disturbance, and the truth for each picture.

    rest image | at rest | the disturbance begins | at rest | presses, at rest after each | it ends | at rest

Pictures are rendered on demand; the light of the undisturbed gel is cached, because all streams use it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.disturbances import WornOptics, noisier
from benchmarks.flow.cases import seen_by
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import INDENTERS
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import NoiseBank, Press
from tactile_nodes.simulation.scene import GAUSS_POINT

CAPTURE, REST, MOVING, HELD = 'capture', 'rest', 'moving', 'held'
BEFORE, DURING, AFTER = 'before', 'during', 'after'
FIRST_NS = 1_000 * NS_PER_S
REACH_MM, SHALLOWEST_MM, DEEPEST_MM = 12.0, 0.3, 1.9
EXPOSURE_S = 0.008
UP = Press(0.0, 0.0, -1.0)

Presses = tuple[Press, ...]


@dataclass(frozen=True)
class Plan:
    """The length of a stream, in frames and presses.

    With eight presses the undisturbed error depends on the seed: 1.0 mN with one and 3.4 mN with another; with twenty
    presses it is 2.1 and 1.8 mN. A press is held for 0.6 s, in which a real camera takes 36 frames.
    """

    presses: int = 40
    before: int = 4
    coming: int = 10
    approach: int = 1
    hold: int = 12
    rest: int = 2
    after: int = 12
    capture: int = 16
    fps: float = 20.0
    seed: int = 11


@dataclass(frozen=True)
class Moment:
    """One frame before rendering: its presses, its place in the course (`press` numbers the presses, from 0), its stamp
    and its age."""

    number: int
    part: str
    kind: str
    presses: Presses = ()
    press: int = -1
    stamp_ns: int = 0
    age_s: float = 0.002

    @property
    def touching(self) -> Presses:
        """The presses with contact."""
        return tuple(each for each in self.presses if each.depth_mm > 0)


def course(plan: Plan, presses: Sequence[Presses]) -> list[Moment]:
    """All frames of a stream with these presses, in order."""
    parts: list[tuple[str, str, Presses, int]] = [(BEFORE, CAPTURE, (), -1)] * plan.capture
    parts += [(BEFORE, REST, (), -1)] * plan.before
    parts += [(DURING, REST, (), -1)] * plan.coming
    for count, each in enumerate(presses):
        way = [_at_share(each, (number + 1) / (plan.approach + 1)) for number in range(plan.approach)]
        parts += [(DURING, MOVING, here, count) for here in way]
        parts += [(DURING, HELD, each, count)] * plan.hold
        parts += [(DURING, MOVING, here, count) for here in reversed(way)]
        parts += [(DURING, REST, (), count)] * plan.rest
    parts += [(AFTER, REST, (), -1)] * plan.after
    period_ns = round(NS_PER_S / plan.fps)
    return [Moment(number, *each, FIRST_NS + number * period_ns) for number, each in enumerate(parts)]


def _at_share(presses: Presses, share: float) -> Presses:
    return tuple(
        dataclasses.replace(
            each, depth_mm=share * each.depth_mm, shift_mm=(share * each.shift_mm[0], share * each.shift_mm[1])
        )
        for each in presses
    )


def random_presses(plan: Plan) -> list[Presses]:
    """Single presses at random places, with depths spread evenly over the range, in random order."""
    random = np.random.default_rng(plan.seed)
    places = random.uniform(-REACH_MM, REACH_MM, (plan.presses, 2))
    shares = (random.permutation(plan.presses) + random.uniform(0, 1, plan.presses)) / plan.presses
    depths = SHALLOWEST_MM + shares * (DEEPEST_MM - SHALLOWEST_MM)
    return [(Press(float(x), float(y), float(depth)),) for (x, y), depth in zip(places.tolist(), depths, strict=True)]


Light = Callable[[np.ndarray, Moment], np.ndarray]
Picture = Callable[[np.ndarray, Moment], np.ndarray]


def while_it_lasts(moment: Moment) -> bool:
    """Acts for disturbances that begin and end."""
    return moment.part == DURING


def in_the_rest_image(moment: Moment) -> bool:
    """Acts for disturbances that end after the rest image."""
    return moment.kind == CAPTURE


def always(_: Moment) -> bool:
    """Acts for disturbances that are also in the rest image, and stay."""
    return True


def from_the_third_press(moment: Moment) -> bool:
    """Acts for disturbances that begin while a tip moves down."""
    return moment.part == DURING and moment.press >= 2


@dataclass(frozen=True)
class Change:
    """The effects of a disturbance. They act on the frames for which `acts` is true.

    `gel`: changes gel and camera. `gone`: selects dark markers. `light`: changes the light before noise. `noise`:
    factor of the noise's standard deviation. `picture`: changes the picture. `presses`: replaces the presses. `course`:
    changes which frames arrive, when, in which order. `values`: changes the features. `speed_mm_s`: speed of the tip
    during held frames. `contact`: the disturbance exists only during contact. `capture`: presses in the rest image.
    `beyond`: for a growing disturbance, the frames in which it is so large that forces may not be used.
    """

    gel: Callable[[Gel], Gel] | None = None
    gone: Callable[[np.ndarray], np.ndarray] | None = None
    light: Light | None = None
    noise: float = 1.0
    picture: Picture | None = None
    presses: Callable[[Sequence[Presses], ForceTables], list[Presses]] | None = None
    course: Callable[[list[Moment]], list[Moment]] | None = None
    values: Callable[[np.ndarray], np.ndarray] | None = None
    speed_mm_s: float = 0.0
    contact: bool = False
    capture: Callable[[int], Presses] | None = None
    acts: Callable[[Moment], bool] = while_it_lasts
    beyond: Callable[[Moment], bool] = always

    @property
    def endless(self) -> bool:
        """Whether it affects the rest image, and so all later frames."""
        return self.acts in (in_the_rest_image, always)


ForceTables = dict[str, ContactTable]


class World:
    """The gel of the models, and its views under disturbances."""

    def __init__(self, gel: Gel | None = None, indenters: Sequence[str] = tuple(INDENTERS)) -> None:
        self.gel = gel or Gel()
        self.tables: ForceTables = {'tip': contact_table(self.gel)}
        self.tables |= {name: contact_table(self.gel, name) for name in indenters}
        self._optics = WornOptics(self.gel, self.tables)
        self.noise = NoiseBank(self.gel)
        self._kept: dict[tuple[Presses, ...], np.ndarray] = {}

    def moments(self, change: Change, plan: Plan) -> list[Moment]:
        """Every frame of a stream before rendering."""
        presses = random_presses(plan)
        if change.presses is not None:
            presses = change.presses(presses, self.tables)
        moments = course(plan, presses)
        if change.capture is not None:
            moments = [_captured(each, change.capture) for each in moments]
        return moments if change.course is None else change.course(moments)

    def frames(self, change: Change, plan: Plan, begin: int = 0) -> Iterator[tuple[Moment, np.ndarray]]:
        """Every frame of a stream from the frame `begin` on, with its picture, cropped as by the camera node."""
        under = self.under(change)
        for moment in self.moments(change, plan)[begin:]:
            yield moment, under.picture(moment)

    def under(self, change: Change) -> View:
        """The camera's view in a stream with a disturbance."""
        gel, gone = self.gel, None
        if change.gel is not None:
            gel = change.gel(gel)
        if change.gone is not None:
            gone = change.gone(self._optics.markers_mm)
        altered = change.gel is not None or change.gone is not None
        worn = WornOptics(gel, self.tables, gone) if altered else None
        noise = NoiseBank(noisier(self.gel, change.noise)) if change.noise != 1 else self.noise
        return View(self, change, worn, noise)

    def light(self, during: tuple[Presses, ...], *, keep: bool = True) -> np.ndarray:
        """Light of the undisturbed gel, in grey levels before noise; cached for presses that are in many streams."""
        if not keep:
            return self._optics.light(during)
        key = tuple(tuple(press for press in each if press.depth_mm > 0) for each in during)
        if key not in self._kept:
            self._kept[key] = self._optics.light(during)
        return self._kept[key]


@dataclass(frozen=True)
class View:
    """The camera's view under a disturbance, with changed optics (`worn`), if any, and its `noise`."""

    world: World
    change: Change
    worn: WornOptics | None
    noise: NoiseBank

    def light(self, moment: Moment) -> np.ndarray:
        """Grey levels over the whole image, before noise."""
        during, acts = _exposed(moment, self.change.speed_mm_s), self.change.acts(moment)
        if acts and self.worn is not None:
            light = self.worn.light(during)
        else:
            light = self.world.light(during, keep=self.change.presses is None and not self.change.speed_mm_s)
        return self.change.light(light, moment) if acts and self.change.light is not None else light

    def variance(self, moment: Moment, light: np.ndarray) -> np.ndarray:
        """Variance of the grey levels of a picture with this light."""
        return (self.noise if self.change.acts(moment) else self.world.noise).variance(light)

    def picture(self, moment: Moment) -> np.ndarray:
        """The picture from the camera, cropped as by the camera node."""
        acts, light = self.change.acts(moment), self.light(moment)
        picture = (self.noise if acts else self.world.noise).expose(light, FIRST_NS + moment.number)
        if acts and self.change.picture is not None:
            picture = self.change.picture(picture, moment)
        return np.ascontiguousarray(seen_by(picture))


def _captured(moment: Moment, presses: Callable[[int], Presses]) -> Moment:
    return dataclasses.replace(moment, presses=presses(moment.number)) if moment.kind == CAPTURE else moment


def _exposed(moment: Moment, speed_mm_s: float) -> tuple[Presses, ...]:
    """The presses at two moments of the exposure, which together have its mean and variance."""
    if speed_mm_s == 0 or moment.kind != HELD:
        return (moment.presses,)
    off_mm = speed_mm_s * EXPOSURE_S * GAUSS_POINT
    return tuple(
        tuple(dataclasses.replace(each, depth_mm=each.depth_mm + sign * off_mm) for each in moment.presses)
        for sign in (-1, 1)
    )


def force_n(moment: Moment, tables: ForceTables) -> float:
    """The true normal force of all presses."""
    return math.fsum(tables[each.indenter].force_at(each.depth_mm) for each in moment.touching)
