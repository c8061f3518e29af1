"""Changes of a simulated sensor after its calibration, and their effect on forces and on the drift monitor."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.disturbances import dimmed, knocked, other_markers, shrunk, warmed
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.nodes.drift_monitor import DriftMonitorParams
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.judge.drift import SOONER, DriftMonitor, Limits
from tactile_nodes.sensing.judge.drift_alarm import Level
from tactile_nodes.sensing.judge.drift_verdict import Reason, Verdict
from tactile_nodes.sensing.metrics import root_mean_square
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

NS_PER_S = 1_000_000_000
PERIOD_S, WATCHED_S = DriftMonitorParams().check_s, 20
"""Interval of the monitor's checks, as live (shorter when it suspects a fault), and time of checks after a change."""
SEED, REACH_MM, DEEPEST_MM = 3, 12.0, 2.0
REST_FRAMES = 16
CONTACT_HZ, INDEPENDENT_HZ, INDEPENDENT_NOISE_N, DELAY_S = 30, 200, 0.01, 0.01
WEIGHT_G = 50.0
BODIES = (
    (Press(3.0, -4.0, 1.2),),
    (Press(-6.0, 5.0, 1.5, 'ball'),),
    (Press(7.0, 2.0, 2.0),),
    (Press(-5.0, -5.0, 1.0), Press(6.0, 6.0, 1.5)),
    (Press(0.0, 8.0, 1.0, shift_mm=(0.6, 0.0)),),
    (Press(5.0, 3.0, 1.5, 'ball'), Press(-6.0, -3.0, 1.0, 'ball')),
    (Press(-9.0, 0.0, 1.2, 'punch'),),
)
"""The presses in hours without a fault: tips, balls, punches, two at a time, one that is dragged."""


@dataclass(frozen=True)
class Course:
    """A growing change. `gel` returns the gel at an extent of the change, from the calibrated gel.

    `again`: the rest image is captured again at each extent. `apart`: each extent is applied to a fresh sensor;
    otherwise they follow one another. `compared`: 'sensor' for an independent force on the bus, 'weight' for a known
    weight on the gel.
    """

    name: str
    unit: str
    extents: tuple[float, ...]
    gel: Callable[[Gel, float], Gel]
    again: bool = False
    apart: bool = False
    compared: str = ''


@dataclass(frozen=True)
class Effort:
    """The amount of computation: bodies for the monitor's frames, presses for the errors, contacts to compare."""

    bodies: tuple[tuple[Press, ...], ...] = BODIES
    presses: int = 40
    contacts: int = 8


@dataclass(frozen=True)
class Point:
    """One extent: force errors, share flagged by the model, the monitor's report, and its delay."""

    extent: float
    force_rmse_n: float
    place_median_mm: float
    flagged: float
    level: str
    reasons: str
    after_s: float | None


def _stiffer(gel: Gel, percent: float) -> Gel:
    return dataclasses.replace(gel, shear_modulus_mpa=gel.shear_modulus_mpa * (1 + percent / 100))


def _exchanged(gel: Gel, number: float) -> Gel:
    return other_markers(gel, round(number))


STIFFENING = (0.0, 2.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 18.0, 20.0, 30.0, 50.0)
KNOCKS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
COURSES = (
    Course('the camera is knocked', 'px', KNOCKS, knocked, apart=True),
    Course('knocked, rest image captured again', 'px', (0.3, 0.5, 1.0, 2.0, 4.0, 8.0), knocked, True, apart=True),
    Course('the light fades', 'of the light', (1.0, 0.9, 0.7, 0.5, 0.4, 0.38, 0.3, 0.2, 0.14, 0.1), dimmed),
    Course('the gel stiffens, an independent force beside it', '%', STIFFENING, _stiffer, compared='sensor'),
    Course('the gel stiffens, a weight put on it', '%', STIFFENING, _stiffer, compared='weight'),
    Course('the gel stiffens, nothing to compare with', '%', (0.0, 10.0, 20.0, 50.0), _stiffer),
    Course('the gel shrinks as it cures on', '% of thickness', (0.1, 0.2, 0.3, 0.5, 1.0), shrunk),
    Course('it shrank, rest image captured again', '% of thickness', (0.1, 0.3, 1.0, 3.0), shrunk, True),
    Course('it warms up', 'min', (0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 40.0, 60.0), warmed),
    Course('it warms up, rest image captured again', 'min', (1.0, 3.0, 8.0, 20.0, 60.0), warmed, True),
    Course(
        'another gel is put in, rest image captured again', 'exchanged', (1.0, 2.0, 3.0), _exchanged, True, apart=True
    ),
    Course('another gel is put in while sensing', 'exchanged', (1.0, 2.0), _exchanged, apart=True),
)


class Sensor:
    """A gel under a camera: its pictures, cropped for the model. Every picture has its own noise."""

    def __init__(self, gel: Gel, calibrated: Gel, side_px: int, indenters: Collection[str] = ()) -> None:
        others = {name: contact_table(calibrated, name) for name in indenters if name != 'tip'}
        # A slightly thinner layer keeps its forces: only the places of its markers matter here.
        self.table = contact_table(dataclasses.replace(gel, soft_mm=calibrated.soft_mm))
        self._optics, self._side_px, self._seed = Optics(gel, self.table, others), side_px, 0

    def picture(self, presses: tuple[Press, ...] = ()) -> np.ndarray:
        """A picture from the camera."""
        self._seed += 1
        image = self._optics.render(presses, self._seed)
        return np.ascontiguousarray(centre_crop(image, self._side_px, self._side_px))

    def rest(self) -> np.ndarray:
        """The mean of some pictures of the untouched gel."""
        return average([self.picture() for _ in range(REST_FRAMES)])


class Reader:
    """Runs the model as the live nodes do."""

    def __init__(self, loaded: LoadedModel) -> None:
        self._flow, self._encoding = make_flow(*loaded.flow), make_encoding(*loaded.encoding)
        self._estimator = ForceEstimator(loaded.model)
        self.threshold_n = loaded.model.contact_threshold_n

    def use_rest(self, picture: np.ndarray) -> None:
        """Set the rest image."""
        self._flow.set_reference(picture)
        self._encoding.set_reference(picture)

    def read(self, picture: np.ndarray) -> ForceMap:
        """The force in a picture."""
        return self._estimator.predict(self._encoding.encode(self._flow.displacement(picture)))


class Bench:
    """A calibrated sensor with its drift monitor, over time."""

    def __init__(self, loaded: LoadedModel, gel: Gel, effort: Effort | None = None) -> None:
        self._effort = effort or Effort()
        self._gel, self._side_px, self._now_s = gel, loaded.image_size[0], 0.0
        self.reader, self.monitor = Reader(loaded), DriftMonitor(Limits.of_flow(loaded.flow[0]))
        self._random = np.random.default_rng(SEED)
        calibrated = self.sensor(gel).rest()
        self.monitor.use_calibration(calibrated)
        self.capture(self.sensor(gel))

    def sensor(self, gel: Gel) -> Sensor:
        """The sensor with another gel, camera or light."""
        indenters = {press.indenter for presses in self._effort.bodies for press in presses}
        return Sensor(gel, self._gel, self._side_px, indenters)

    def capture(self, sensor: Sensor) -> None:
        """Capture a new rest image."""
        rest = sensor.rest()
        self.reader.use_rest(rest)
        self.monitor.rest(rest)

    def watch(self, sensor: Sensor, for_s: float = WATCHED_S) -> float | None:
        """Run the monitor for `for_s`, half of it with presses; returns after how many seconds the level rose."""
        before, risen, bodies = self.monitor.verdict.level, None, self._effort.bodies
        for at_s in np.arange(0.0, for_s, SOONER * PERIOD_S).tolist():
            if not self.monitor.is_due(at_ns := self._at(at_s), PERIOD_S):
                continue
            presses = bodies[int(at_s // 16) % len(bodies)] if at_s % 8 >= 4 else ()
            self.monitor.frame(at_ns, sensor.picture(presses))
            if risen is None and self.monitor.verdict.level > before:
                risen = at_s
        self._now_s += for_s
        return risen

    def rest_for_hours(self, hours: float) -> Iterator[tuple[float, Verdict]]:
        """Run the monitor without a fault, with presses by one body after another; yields time and verdict."""
        sensor, reader, bodies = self.sensor(self._gel), self.reader, self._effort.bodies
        for number in range(round(hours * 3600 / PERIOD_S)):
            at_s = number * PERIOD_S
            presses = bodies[round(at_s // 4) % len(bodies)] if at_s % 4 >= 1 else ()
            picture, at_ns = sensor.picture(presses), self._at(at_s)
            self.monitor.frame(at_ns, picture)
            found = reader.read(picture)
            touching = found.total_n >= reader.threshold_n
            self.monitor.force(at_ns, found.total_n, found.unlikeness, in_contact=touching)
            yield at_s, self.monitor.verdict

    def compare(self, sensor: Sensor, how: str) -> None:
        """Make contacts with an independent force, or put on the weight."""
        if how == 'weight':
            self._weigh(sensor)
        else:
            for place in self._random.uniform(-8, 8, (self._effort.contacts, 2)):
                self._contact(sensor, (float(place[0]), float(place[1])))

    def _contact(self, sensor: Sensor, place: tuple[float, float]) -> None:
        """Three seconds with one press of one second."""
        bias = self._random.normal(0, 2, 3)
        for number in range(3 * INDEPENDENT_HZ):
            at_s = number / INDEPENDENT_HZ
            force_n = sensor.table.force_at(_depth_mm(at_s - DELAY_S))
            x, y, z = (float(each) for each in bias + self._random.normal(0, INDEPENDENT_NOISE_N, 3))
            self.monitor.independent_force(self._at(at_s), (x, y, z - force_n))
        for number in range(3 * CONTACT_HZ):
            at_s = number / CONTACT_HZ
            self._read(sensor, (Press(*place, _depth_mm(at_s)),), at_s)
        self._now_s += 3

    def _weigh(self, sensor: Sensor) -> None:
        depths = np.linspace(0.05, DEEPEST_MM, 400)
        forces = [sensor.table.force_at(float(depth)) for depth in depths]
        depth_mm = float(np.interp(WEIGHT_G * 9.80665e-3, forces, depths))
        for number in range(2 * CONTACT_HZ):
            self._read(sensor, (Press(1.0, -2.0, depth_mm),), number / CONTACT_HZ)
        self.monitor.weigh(WEIGHT_G)
        self._now_s += 10

    def _read(self, sensor: Sensor, presses: tuple[Press, ...], at_s: float) -> None:
        found = self.reader.read(sensor.picture(presses))
        touching = found.total_n >= self.reader.threshold_n
        self.monitor.force(self._at(at_s), found.total_n, found.unlikeness, in_contact=touching)

    def _at(self, since_s: float) -> int:
        return round((self._now_s + since_s) * NS_PER_S)

    def errors(self, sensor: Sensor) -> tuple[float, float, float]:
        """Force RMSE (N) and median error of the place (mm) over presses, and the share that the model flags."""
        random = np.random.default_rng(SEED)
        forces, places, flagged = [], [], []
        for x, y, share in random.uniform(-1, 1, (self._effort.presses, 3)):
            press = Press(x * REACH_MM, y * REACH_MM, 0.25 + (share + 1) / 2 * (DEEPEST_MM - 0.25))
            found = self.reader.read(sensor.picture((press,)))
            forces.append(found.total_n - sensor.table.force_at(press.depth_mm))
            places.append(math.dist(found.contact_mm, (press.x_mm, press.y_mm)))
            flagged.append(found.unlikeness > 1)
        return root_mean_square(np.array(forces)), float(np.median(places)), float(np.mean(flagged))


def _depth_mm(at_s: float) -> float:
    """Depth of a press that lasts from 1 to 2 s; negative without contact."""
    return 1.5 * math.sin(math.pi * (at_s - 1)) if 1 < at_s < 2 else -1.0


def follow(course: Course, loaded: LoadedModel, gel: Gel, effort: Effort | None = None) -> list[Point]:
    """Measure all extents of a course, in turn."""
    points, bench = [], Bench(loaded, gel, effort)
    for extent in course.extents:
        if course.apart:
            bench = Bench(loaded, gel, effort)
        sensor = bench.sensor(course.gel(gel, extent))
        if course.again:
            bench.capture(sensor)
        if course.compared:
            bench.compare(sensor, course.compared)
        after_s = bench.watch(sensor)
        verdict = bench.monitor.verdict
        reasons = ', '.join(str(each.name).lower().replace('_', ' ') for each in Reason if each in verdict.reasons)
        level = Level(verdict.level).name.lower()
        points.append(Point(extent, *bench.errors(sensor), level, reasons, after_s))
    return points
