"""Accuracy of described sensors for contacts of ten families, without a calibration press and after some.

Each sensor that ships (config/sensors) is simulated from its description and touched as in `tactile bench contacts`.
Forces are estimated with the model that `tactile calibrate --sensor NAME` makes from the same description, and after
presses of a ball as `tactile press` asks for them, by the chain of the live launch.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.contacts import read
from benchmarks.contacts.page import share
from benchmarks.harness.declaration import SENSING, SIMULATED, Aim, Benchmark, Result, argument, reached
from benchmarks.harness.report import opening, shown, table
from benchmarks.harness.running import Run
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory

if TYPE_CHECKING:
    from tactile_nodes.sensors import Sensor

PAPERS = 'simulated'
AIM = 1.5
SEED, PER_FAMILY = 606, 2
PRESSES, BALL = 30, 'ball:3'
ABOUT = """\
{frames} contacts of ten families on each sensor (seed {seed}), most of them dragged, up to 3 N. Without presses, the
response of the gel is computed from the description, whose modulus only `simulated` knows (`gel.moduli_off`); so no
force of the others is ok. With presses, the simulated hand of `tactile press` pressed a ball ({ball}, radius in mm) on
the same gel, and `tactile calibrate --pictures` calibrated with them. Columns are explained in
[contacts.md](contacts.md); *CPU* is the median time of the whole chain on one thread. [sensors.md](../sensors.md) lists
what each description assumes."""
TARGETS = "Ratios to the values of the paper's sensor, `simulated`, without presses and with {presses}:"


def shipped() -> list[str]:
    """Names of the shipped sensors, the paper's first."""
    names = {each.stem for each in (share_directory() / 'config' / 'sensors').glob('*.yaml')} - {PAPERS}
    return [PAPERS, *sorted(names)]


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure all sensors, one after another."""
    return {
        'seed': arguments.seed, 'each': arguments.each, 'presses': arguments.presses,
        'sensors': of_each(arguments, run, _measured),
    }  # fmt: skip


def of_each(
    arguments: argparse.Namespace, run: Run, measured: Callable[[str, argparse.Namespace, Run], Any]
) -> dict[str, Any]:
    """What is measured of each of the sensors in `arguments.only`, by default all, as a part of the run.

    Raises:
        ConfigurationError: no such sensor ships.
    """
    if unknown := [each for each in arguments.only if each not in shipped()]:
        raise ConfigurationError(f'no sensor {unknown[0]!r} ships; there are: {", ".join(shipped())}')
    chosen = [name for name in shipped() if name in (arguments.only or shipped())]
    return {name: run.part(name, partial(measured, name, arguments, run)) for name in chosen}


@contextlib.contextmanager
def model_of(name: str, sensor: Sensor, run: Run) -> Iterator[str]:
    """The file of the model that follows from a description, until it is no longer used."""
    from tactile_nodes.learning.field.calibration import described_model
    from tactile_nodes.model_file import find_model, load_model

    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / f'{name}.safetensors'
        described_model(load_model(find_model('field')), sensor, name, model, run.progress)
        yield str(model)


def _measured(name: str, arguments: argparse.Namespace, run: Run) -> dict[str, Any]:
    from benchmarks.contacts.cases import solved, wanted
    from benchmarks.contacts.frames import CONDITIONS
    from benchmarks.contacts.scores import by_family, summed
    from tactile_nodes.sensors import load_sensor
    from tactile_nodes.simulation.described import gel_of

    sensor = load_sensor(name)
    gel = gel_of(sensor)
    touched = run.made(solved, wanted(gel, arguments.seed, arguments.each), 'solving contacts')
    width, height = sensor.image.crop_px
    about = f'{sensor.camera.model}, {width}x{height} px of {sensor.gel.width_mm:g}x{sensor.gel.height_mm:g} mm'
    found: dict[str, Any] = {'about': about, 'bins': f'{sensor.bins.rows}x{sensor.bins.cols}'}
    with model_of(name, sensor, run) as model:
        for presses in (0, arguments.presses):
            file = _pressed(name, model, presses) if presses else model
            scores, _ = read({name: file}, gel, touched, CONDITIONS[0], run.progress)
            found[str(presses)] = {**summed(scores[name]), 'families': by_family(scores[name])}
    return found


def _pressed(name: str, model: str, presses: int) -> str:
    """The file of a model after presses, made as by a person, even if the command would keep the model as it is."""
    folder, made = Path(model).parent / 'presses', Path(model).with_name('calibrated.safetensors')
    press = ['press', str(folder), '--sensor', name, '--indenter', BALL, '--presses', str(presses)]
    calibrate = ['calibrate', '--pictures', str(folder / 'presses.csv'), '--model', model, '--gel', 'pressed']
    own_list = {**os.environ, 'TACTILE_GELS': str(folder.parent / 'gels.sqlite')}
    for words in (press, [*calibrate, '--force', '-o', str(made)]):
        command = [sys.executable, '-m', 'tactile_nodes', *words]
        done = subprocess.run(command, env=own_list, check=False, capture_output=True, text=True)
        if done.returncode:
            raise ConfigurationError(f'tactile {" ".join(words)} failed: {done.stderr}')
    return str(made)


def page(result: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    sensors, numbers = result['sensors'], ('0', str(result['presses']))
    frames = next(iter(sensors.values()))['0']['frames']
    about = ABOUT.format(frames=frames, seed=result['seed'], ball=BALL)
    heads = [
        'sensor', 'camera and surface', 'bins', 'presses', 'misplaced', 'total rms [N]', 'median', 'centre [mm]',
        'shear', 'map r', 'total covered', 'ok', 'worst while ok', 'CPU [ms]',
    ]  # fmt: skip
    rows = [_row(name, each, number) for name, each in sensors.items() for number in numbers]
    parts = [*opening('Described sensors', result, about), table(heads, rows)]
    if PAPERS in sensors and len(sensors) > 1:
        parts += ['## Targets', TARGETS.format(presses=result['presses']), reached(AIMS, result)]
    return '\n\n'.join(parts)


def _row(name: str, sensor: Mapping[str, Any], number: str) -> list[str]:
    each = sensor[number]
    return [
        name, sensor['about'], sensor['bins'], number if int(number) else 'none', share(each['misplaced']),
        f'{each["total_rms_n"]:.3f}', share(each['total_median']), f'{each["centre_mm_median"]:.3f}',
        share(each['shear_median']), f'{each["map_r"]:.2f}', share(each['total_held']), share(each['ok']),
        shown(each['worst_while_ok'], '{:.1f}'), f'{each["cpu_ms"]:.1f}',
    ]  # fmt: skip


def _beside_the_papers(name: str) -> Any:
    """A function for the error of each other sensor as a multiple of the paper's."""

    def multiples(result: Mapping[str, Any]) -> dict[str, str]:
        others = {sensor: each for sensor, each in result['sensors'].items() if sensor != PAPERS}
        return {
            sensor: ', '.join(_multiple(result, each, name, number) for number in ('0', str(result['presses'])))
            for sensor, each in others.items()
        }

    return multiples


def _multiple(result: Mapping[str, Any], sensor: Mapping[str, Any], name: str, number: str) -> str:
    times = sensor[number][name] / result['sensors'][PAPERS][number][name]
    return f'{times:.2f}' + ('' if times <= AIM else ' **not reached**')


AIMS = (
    Aim('misplaced force', f'at most {AIM}', _beside_the_papers('misplaced')),
    Aim('median error of the total', f'at most {AIM}', _beside_the_papers('total_median')),
    Aim('error of the centre', f'at most {AIM}', _beside_the_papers('centre_mm_median')),
)

BENCHMARK = Benchmark(
    name='sensors',
    about=__doc__,
    sources=(
        'benchmarks/sensors.py', 'benchmarks/contacts/**', 'benchmarks/stability/chain.py',
        'tactile_nodes/learning/field/**', 'tactile_nodes/learning/guided/**', 'tactile_nodes/sensors/**',
        'config/sensors/**', *SENSING, *SIMULATED,
    ),
    page=page,
    measure=measure,
    tasks=True,
    seed=SEED,
    arguments=(
        argument(
            '--each', type=int, default=PER_FAMILY, metavar='N', help=f'contacts of each family (default: {PER_FAMILY})'
        ),
        argument(
            '--presses', type=int, default=PRESSES, metavar='N', help=f'presses to calibrate (default: {PRESSES})'
        ),
        argument('--only', nargs='*', default=[], metavar='SENSOR', help='only these sensors'),
    ),
    example="""\
examples:
  tactile bench sensors -o docs/results
  tactile bench sensors --each 1 --only speckle_membrane    # a few contacts, to see that it runs""",
)  # fmt: skip
