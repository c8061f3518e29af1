"""The test for untouched frames: missed touches, false alarms, and the time saved by skipping such frames.

Simulated touches of known force at random places on several gels, and frames at rest, without and with disturbances.
Then a minute of presses and pauses, in which each model processes every frame with the test and without it, in turn:
CPU time of one process on one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from benchmarks.flow.cases import Sensor, seen_by
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.report import in_turn
from benchmarks.harness.running import Run
from benchmarks.untouched.page import page
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.measure import MeasureMemory, measure
from tactile_nodes.sensing.explain.model import ForceEstimator
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.patches import moved_image
from tactile_nodes.sensing.picture.quality import picture_faults
from tactile_nodes.sensing.picture.stillness import StillnessCheck, StillnessOptions
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.scene import NS_PER_S, PressSchedule, Scene

GELS = ('paper', 'stiff', 'thin', 'lifelike')
FORCES_N = (0.005, 0.01, 0.015, 0.02, 0.03, 0.05)
REACH_MM = 13.5
"""The range of presses in the paper and in `tactile evaluate`."""
CORNER_MM = (13.0, 14.0)
"""Distance from the middle along both axes: the outermost presses in training."""
FRAMES_A_SECOND = 60
FIRST_SEED = 60_000


def _grey(light: np.ndarray) -> np.ndarray:
    picture: np.ndarray = np.clip(np.round(light), 0, 255).astype(np.uint8)
    return picture


def _dirty(image: np.ndarray) -> np.ndarray:
    dirty: np.ndarray = image.copy()
    dirty[200:210, 150:160] = 20
    return dirty


Change = Callable[[np.ndarray], np.ndarray]
DISTURBANCES: dict[str, Change] = {
    'nothing': lambda image: image,
    'light 1 % brighter': lambda image: _grey(1.01 * image),
    'light 2 % darker': lambda image: _grey(0.98 * image),
    'light 5 % darker': lambda image: _grey(0.95 * image),
    'light 10 % brighter': lambda image: _grey(1.1 * image),
    'a brighter side, 5 %': lambda image: _grey(image * np.linspace(0.95, 1.05, image.shape[1])),
    'camera knocked by 0.02 px': lambda image: _grey(moved_image(image.astype(np.float32), 0.02, 0.0)),
    'camera knocked by 0.1 px': lambda image: _grey(moved_image(image.astype(np.float32), 0.1, 0.0)),
    'camera knocked by 1 px': lambda image: _grey(moved_image(image.astype(np.float32), 1.0, 0.0)),
    'blurred by 0.5 px': lambda image: cv2.GaussianBlur(image, (0, 0), 0.5),
    'dirt, 10x10 px': _dirty,
    'half as much noise again': lambda image: _grey(image + np.random.default_rng(1).normal(0, 2.2, image.shape)),
    'twice the noise': lambda image: _grey(image + np.random.default_rng(1).normal(0, 3.5, image.shape)),
}
"""Disturbances of the picture; the default gel's camera has a noise of 2 grey levels."""


@dataclass(frozen=True)
class Plan:
    """Numbers of touches per force and of frames at rest on each gel, of frames per disturbance, and seconds.

    There are more touches of 20 mN: `at_20_mn` on the paper's gel, and a quarter of that on each other gel.
    """

    touches: int = 200
    at_20_mn: int = 2000
    rests: int = 500
    disturbed: int = 60
    seconds: float = 60.0


QUICK = Plan(touches=4, at_20_mn=8, rests=8, disturbed=2, seconds=1.2)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure as requested on the command line."""
    cv2.setNumThreads(1)
    plan = QUICK if arguments.quick else Plan()
    if arguments.seconds is not None:
        plan = Plan(**{**asdict(plan), 'seconds': arguments.seconds})
    return all_numbers(arguments.model or ['fast', 'portable'], plan, run.progress, run.part)


def all_numbers(models: Sequence[str], plan: Plan, progress: Progress, part: Part = at_once) -> Result:
    """All numbers of the page."""
    return {
        'plan': asdict(plan),
        'options': asdict(StillnessOptions()),
        'gels': {name: part(name, partial(gel_rates, name, plan, progress)) for name in GELS},
        'disturbances': part('disturbances', partial(disturbed_rates, plan, progress)),
        'minute': minute(models, plan.seconds, progress),
    }


def gel_rates(name: str, plan: Plan, progress: Progress) -> dict[str, Any]:
    """For one gel, the motion found in frames at rest, in touches by force, and in touches of 20 mN in the corners."""
    gel = load_gel(name)
    sensor, table = Sensor(gel), contact_table(gel)
    look, random = _check(sensor), np.random.default_rng(FIRST_SEED)
    at_20_mn = plan.at_20_mn if name == 'paper' else -(-plan.at_20_mn // 4)
    counts = {force: at_20_mn if force == 0.02 else plan.touches for force in FORCES_N}
    steps = plan.rests + sum(counts.values()) + plan.touches
    with progress.bar(f'touching the {name} gel', steps) as bar:

        def motion(places: np.ndarray, depth_mm: float) -> dict[str, float]:
            found = []
            for number, (x_mm, y_mm) in enumerate(places.tolist()):
                image = sensor.image((Press(x_mm, y_mm, depth_mm),), 2 * FIRST_SEED + number)
                found.append(look.look(image).motion)
                bar.advance()
            return _shares(found, look.options.limit)

        rest = motion(np.zeros((plan.rests, 2)), -1.0)
        touches = {
            f'{force:g}': motion(random.uniform(-REACH_MM, REACH_MM, (count, 2)), table.depth_at(force))
            for force, count in counts.items()
        }
        sides = random.choice((-1.0, 1.0), (plan.touches, 2))
        corners = motion(sides * random.uniform(*CORNER_MM, (plan.touches, 2)), table.depth_at(0.02))
    return {'rest': rest, 'touches': touches, 'corners': corners}


def _shares(motion: Sequence[float], limit: float) -> dict[str, float]:
    """The number of frames, the number within the limit, and minimum, median and maximum of the motion."""
    return {
        'count': len(motion), 'within': int((np.array(motion) <= limit).sum()), 'least': float(min(motion)),
        'median': float(np.median(motion)), 'most': float(max(motion)),
    }  # fmt: skip


def disturbed_rates(plan: Plan, progress: Progress) -> dict[str, dict[str, float]]:
    """By disturbance: shares of frames at rest that are measured, and of touches of 20 mN that are missed."""
    sensor = Sensor()
    look, random = _check(sensor), np.random.default_rng(2)
    depth = contact_table(sensor.gel).depth_at(0.02)
    found: dict[str, dict[str, float]] = {}
    with progress.bar('disturbing', len(DISTURBANCES) * plan.disturbed) as bar:
        for name, change in DISTURBANCES.items():
            still = {'rest': 0, 'touch': 0}
            for number in range(plan.disturbed):
                x_mm, y_mm = random.uniform(-REACH_MM, REACH_MM, 2).tolist()
                pressed = sensor.image((Press(x_mm, y_mm, depth),), 4 * FIRST_SEED + number)
                still['rest'] += look(change(sensor.image((), 3 * FIRST_SEED + number)))
                still['touch'] += look(change(pressed))
                bar.advance()
            found[name] = {'measured': 1 - still['rest'] / plan.disturbed, 'missed': still['touch'] / plan.disturbed}
    return found


def _check(sensor: Sensor) -> StillnessCheck:
    """The node's test, but without its regular measurement of still frames."""
    look = StillnessCheck(StillnessOptions(full_every=1_000_000))
    look.set_reference(sensor.rest)
    return look


@dataclass
class _Way:
    """One model with or without the test: its results and their cost."""

    rest: PreparedRest
    memory: MeasureMemory
    estimator: ForceEstimator
    cpu_ms: list[float]
    total_n: list[float]
    untouched: list[bool]

    @classmethod
    def of(cls, model: str, rest: np.ndarray, check: StillnessOptions | None) -> _Way:
        loaded = load_model(find_model(model))
        measuring = Measuring(make_flow(*loaded.flow), make_encoding(*loaded.encoding), check=check)
        return cls(measuring.beside(rest), MeasureMemory(None), ForceEstimator(loaded.model), [], [], [])

    def answer(self, image: np.ndarray) -> None:
        """Compute for one frame what the live nodes compute."""
        start = time.process_time_ns()
        frame = Frame(image, types.Header(), 0)
        measure(self.memory, self.rest, frame)
        picture_faults(image)
        assert frame.features is not None
        found = (self.estimator.at_rest if frame.untouched else self.estimator.predict)(frame.features)
        self.cpu_ms.append((time.process_time_ns() - start) / 1e6)
        self.total_n.append(found.total_n)
        self.untouched.append(frame.untouched)


def minute(models: Sequence[str], seconds: float, progress: Progress) -> dict[str, Any]:
    """Presses and pauses at 60 frames a second: costs and results of each model, with the test and without."""
    sensor = Sensor()
    scene = Scene(sensor.gel, PressSchedule(seed=7, period_s=2.0), table=contact_table(sensor.gel))
    ways = {
        model: {'without': _Way.of(model, sensor.rest, None), 'with': _Way.of(model, sensor.rest, StillnessOptions())}
        for model in models
    }
    order = [way for both in ways.values() for way in both.values()]
    true_n, frames = [], round(seconds * FRAMES_A_SECOND)
    with progress.bar('a minute of presses and pauses', frames) as bar:
        for number in range(frames):
            at_ns = number * NS_PER_S // FRAMES_A_SECOND
            image = seen_by(scene.render(at_ns))
            for way in in_turn(order, number):
                way.answer(image)
            true_n.append(scene.truth(at_ns).total_n)
            bar.advance()
    return {model: _compared(both['without'], both['with'], np.array(true_n)) for model, both in ways.items()}


def _compared(without: _Way, with_look: _Way, true_n: np.ndarray) -> dict[str, Any]:
    touching, untouched = true_n > 0, np.array(with_look.untouched)
    times = {'without': np.array(without.cpu_ms), 'with': np.array(with_look.cpu_ms)}
    totals = {'without': np.array(without.total_n), 'with': np.array(with_look.total_n)}
    return {
        'frames': len(true_n),
        'touching': int(touching.sum()),
        'untouched': int(untouched.sum()),
        'untouched_at_rest': int((untouched & ~touching).sum()),
        'most_missed_n': float(true_n[untouched].max(initial=0.0)),
        'missed_20_mn': int((untouched & (true_n >= 0.02)).sum()),
        'rest_ms': {name: float(np.median(each[~touching])) for name, each in times.items()},
        'touch_ms': {name: float(np.median(each[touching])) for name, each in times.items()},
        'cpu_s': {name: float(each.sum() / 1e3) for name, each in times.items()},
        'rmse_n': {name: float(np.sqrt(np.square(each - true_n).mean())) for name, each in totals.items()},
        'same_when_measured': bool((totals['with'] == totals['without'])[~untouched].all()),
    }


BENCHMARK = Benchmark(
    name='untouched',
    about=__doc__,
    sources=('benchmarks/untouched/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    quick=True,
    arguments=(
        argument('model', nargs='*', help='model files, or names of models that ship (default: fast portable)'),
        argument('--seconds', above=0, type=float, metavar='S', help='duration of presses and pauses (default: 60)'),
    ),
)
