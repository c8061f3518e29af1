"""Described sensors in disturbed pictures: false force at rest, and the error of a tip's force.

Each sensor that ships (config/sensors) is simulated from its description, and read with the model that `tactile
calibrate --sensor NAME` makes from it, by the chain of the live launch. The picture is disturbed after the rest image
was taken; half a second later a tip begins to press at random places.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import disturbances as disturb
from benchmarks.contacts.frames import CONDITIONS, HELD_FRAMES, RATE_HZ, Condition, TouchOptics
from benchmarks.contacts.scores import COVERED
from benchmarks.harness.declaration import SENSING, SIMULATED, Aim, Benchmark, Result, argument, reached
from benchmarks.harness.report import opening, table
from benchmarks.harness.running import Run
from benchmarks.sensors import SEED, model_of, of_each
from benchmarks.stability.chain import REST_FRAMES, Chain
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.simulation.optics import Press

if TYPE_CHECKING:
    from tactile_nodes.messages import types
    from tactile_nodes.sensors import Sensor

PRESSES, RIM_MM = 12, 3.0
SHALLOWEST_MM, DEEPEST_MM = 0.4, 1.2
FREE_FRAMES = 8
UNDISTURBED = CONDITIONS[0].name
DISTURBED = (
    *(each for each in CONDITIONS if each.gone is None),
    Condition('re-seated by 0.3 mm', lambda gel: disturb.reseated(gel, 0.3)),
    Condition('1 % larger', lambda gel: disturb.magnified(gel, 1.0)),
)
FALSE_N, TIMES = 0.02, 1.5
SHARES = 'error', 'covered', 'invalid'
ABOUT = """\
{presses} presses of the tip on each sensor (seed {seed}), {low:g} to {high:g} mm deep. *false* is the largest force [N]
in frames without contact, *error* the median relative error of the force in contact, *covered* the share of these
forces that lie in their 90 % intervals, and *invalid* the share of frames in contact without a force. The sensors were
not calibrated with presses."""


@dataclass(frozen=True)
class Told:
    """The force message of a frame, and the true force (N)."""

    force: types.ForceDistribution
    true_n: float


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure all sensors, one after another."""
    return {'seed': arguments.seed, 'presses': arguments.presses, 'sensors': of_each(arguments, run, _measured)}


def _measured(name: str, arguments: argparse.Namespace, run: Run) -> dict[str, Any]:
    from tactile_nodes.sensors import load_sensor

    sensor, found = load_sensor(name), {}
    with model_of(name, sensor, run) as model, run.progress.bar(name, len(DISTURBED)) as bar:
        for condition in DISTURBED:
            found[condition.name] = _summed(list(_told(sensor, model, condition, arguments)))
            bar.advance(1, condition.name)
    return found


def _told(sensor: Sensor, model: str, condition: Condition, arguments: argparse.Namespace) -> Iterator[Told]:
    """The force of the last frame at rest before each press, of its last frame, and of the last frame at rest."""
    from tactile_nodes.contact_tables.gel_tables import contact_table
    from tactile_nodes.simulation.described import gel_of

    gel = gel_of(sensor)
    chain, contacts = Chain(model), contact_table(gel)
    calm = TouchOptics(gel, contacts, {})
    disturbed = TouchOptics(condition.gel(gel), contacts, {}, blur_px=condition.blur_px)
    crop, number = Crop.centred(gel.image_width, gel.image_height, *sensor.image.crop_px), 0

    def read(optics: TouchOptics, frames: int, *presses: Press) -> Told:
        nonlocal number
        for _ in range(frames):
            number += 1
            picture = np.ascontiguousarray(crop.apply(optics.render(presses, arguments.seed + number)))
            force = chain.read(number * NS_PER_S // RATE_HZ, picture)
        return Told(force, sum(contacts.force_at(each.depth_mm) for each in presses))

    read(calm, REST_FRAMES)
    read(disturbed, RATE_HZ // 2)
    for press in _presses(sensor, arguments.presses, arguments.seed):
        yield read(disturbed, FREE_FRAMES)
        yield read(disturbed, HELD_FRAMES, press)
    yield read(disturbed, FREE_FRAMES)


def _presses(sensor: Sensor, count: int, seed: int) -> list[Press]:
    random = np.random.default_rng(seed)
    half = np.maximum(np.array([sensor.gel.width_mm, sensor.gel.height_mm]) / 2 - RIM_MM, 0.0)
    places, depths = half * random.uniform(-1, 1, (count, 2)), random.uniform(SHALLOWEST_MM, DEEPEST_MM, count)
    return [Press(x, y, depth) for (x, y), depth in zip(places.tolist(), depths.tolist(), strict=True)]


def _summed(told: list[Told]) -> dict[str, float]:
    """A force without a value counts as none at rest, and is not counted in contact."""
    rest, pressed = [each for each in told if not each.true_n], [each for each in told if each.true_n]
    known = [each for each in pressed if np.isfinite(each.force.total)]
    off = np.array([each.force.total - each.true_n for each in known])
    true, sigma = np.array([[each.true_n, each.force.total_sigma] for each in known]).reshape(-1, 2).T
    return {
        'false_n': float(np.nanmax([0.0, *(each.force.total for each in rest)])),
        'error': float(np.median(np.abs(off) / true)) if known else np.nan,
        'covered': float((np.abs(off) <= COVERED * sigma).mean()) if known else np.nan,
        'invalid': 1 - len(known) / len(pressed),
    }


def page(result: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    about = ABOUT.format(presses=result['presses'], seed=result['seed'], low=SHALLOWEST_MM, high=DEEPEST_MM)
    parts = opening('Described sensors in disturbed pictures', result, about)
    for name, found in result['sensors'].items():
        rows = [
            [condition, f'{each["false_n"]:.3f}', *(f'{100 * each[key]:.0f} %' for key in SHARES)]
            for condition, each in found.items()
        ]
        parts += [f'## {name}', table(['picture', 'false [N]', *SHARES], rows)]
    return '\n\n'.join([*parts, '## Targets', reached(AIMS, result)])


def _worst(figure: str, undisturbed: bool = False) -> Any:
    """A function for the worst value of a figure over all disturbances, by sensor, and whether it is low enough."""

    def worst(result: Mapping[str, Any]) -> dict[str, str]:
        told = {}
        for name, found in result['sensors'].items():
            value, condition = max((each[figure], condition) for condition, each in found.items())
            most = TIMES * found[UNDISTURBED][figure] if undisturbed else FALSE_N
            shown = f'{100 * value:.0f} %' if undisturbed else f'{value:.3f} N'
            told[name] = f'{shown}, {condition}' + ('' if value <= most else ', **not reached**')
        return told

    return worst


AIMS = (
    Aim('largest false force', f'at most {FALSE_N:g} N', _worst('false_n')),
    Aim('largest error', f'at most {TIMES:g} times undisturbed', _worst('error', undisturbed=True)),
)

BENCHMARK = Benchmark(
    name='sensors_disturbed',
    about=__doc__,
    sources=(
        'benchmarks/sensors_disturbed.py', 'benchmarks/sensors.py', 'benchmarks/disturbances.py',
        'benchmarks/contacts/frames.py', 'benchmarks/stability/chain.py', 'tactile_nodes/learning/field/**',
        'tactile_nodes/sensors/**', 'config/sensors/**', *SENSING, *SIMULATED,
    ),
    page=page,
    measure=measure,
    seed=SEED,
    arguments=(
        argument('--presses', type=int, default=PRESSES, least=1, metavar='N', help=f'presses (default: {PRESSES})'),
        argument('--only', nargs='*', default=[], metavar='SENSOR', help='only these sensors'),
    ),
    example="""\
examples:
  tactile bench sensors_disturbed -o docs/results
  tactile bench sensors_disturbed --presses 2 --only printed_dots    # to see that it runs""",
)  # fmt: skip
