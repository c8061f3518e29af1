"""``tactile calibrate``: make a model for another gel from an existing model and a few presses on the new gel."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.learning.calibrating.files import AnyCalibration
    from tactile_nodes.learning.field.calibration import Pressed
    from tactile_nodes.learning.progress import Progress

DESCRIPTION = (
    'Transfer the model of one gel to another (other hardness, markers, thickness or camera) with a few presses on the '
    'new gel. All images of a held press are used, with the mean force over that time. The result is a model file like '
    'any other. `tactile launch calibrate` does the same while a rig is pressing.'
)
EPILOG = """\
examples:
  tactile calibrate new_gel_bag --model portable --gel gel-7 -o gel-7.safetensors
  tactile calibrate first_bag second_bag --model portable --gel gel-7 -o gel-7.safetensors --curve
  tactile calibrate --dataset new_gel.npz --model portable -o gel-7.safetensors
  tactile calibrate --pictures gel-7.csv --model portable --gel gel-7 -o gel-7.safetensors    # no rig: a scale
  tactile calibrate new_gel_bag --model field --gel gel-7 -o gel-7.safetensors --body ball:5
  tactile calibrate punch_bag --model field --gel gel-7 -o gel-7.safetensors --body punch:1.5    # or ring, part.stl
  tactile calibrate --sensor description.yaml --model field -o mine.safetensors  # any contact, no presses needed
  tactile calibrate --sensor description.yaml --model field -o mine.safetensors --touches 100  # its force map sharper
  tactile calibrate --dataset new_gel.npz --model paper -o gel-7.safetensors  # network: the paper's layer, needs torch
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bags', nargs='*', type=Path, metavar='BAG', help='a bag of presses on the new gel')
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='a data set of presses, instead of bags')
    parser.add_argument('--pictures', type=Path, metavar='CSV', help='presses by hand: a table that lists pictures')
    parser.add_argument(
        '--untouched-below', type=float, default=0.0, metavar='N',
        help='with --pictures: forces up to this value are no contact',
    )  # fmt: skip
    parser.add_argument('--model', required=True, help='model to start from: a file, or the name of a shipped one')
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='FILE', help='model file to write')
    parser.add_argument(
        '--gel', default='', help='name of the new gel, or the YAML file of a simulated one; a data set names its own'
    )
    parser.add_argument(
        '--curve', action='store_true', help='also print the error against the number of presses (of tips: with bags)'
    )
    parser.add_argument('--layer', type=Path, metavar='FILE', help="for a network: settings of the paper's layer")
    parser.add_argument(
        '--sensor', metavar='YAML', help='for a model of any contact: the sensor description, if the sensor differs'
    )
    parser.add_argument(
        '--body', default='', help='for a model of any contact: the indenter, if it differs: ball:R or punch:R '
        '(radius in mm), or a value of contact:= of the live launch, e.g. ring, part.stl'
    )  # fmt: skip
    parser.add_argument('--indenter', default='', metavar='NAME', help='use only presses of this indenter')
    parser.add_argument(
        '--touches', type=int, default=0, metavar='N', help='with --sensor alone: learn from N simulated touches of '
        'random bodies to put forces into the right bins, e.g. 100 (some ten seconds each, once; needs torch)'
    )  # fmt: skip
    parser.add_argument('--namespace', help='namespace of the sensor, if the bags hold several')
    parser.add_argument(
        '--force', action='store_true', help='write the model even if it is no better on held-out presses than before'
    )


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.calibrating.listing import listed
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import check_model_output, find_model

    given = sum(map(bool, (arguments.bags, arguments.dataset, arguments.pictures)))
    if not given and arguments.sensor:
        _require_used(arguments)
        return _of_description(arguments)
    if given != 1:
        raise ConfigurationError(
            'give the presses on the new gel (bags, --dataset FILE or --pictures CSV), or --sensor alone'
        )
    _require_used(arguments)
    model = find_model(arguments.model)
    named = map(Path, filter(None, (arguments.sensor, arguments.body, arguments.gel)))
    check_model_output(
        arguments.output, *arguments.bags, arguments.dataset, arguments.pictures, arguments.layer, model, *named
    )
    command, progress = shlex.join(['tactile', *sys.argv[1:]]), TerminalProgress()
    if not (arguments.gel or arguments.dataset):
        progress.say('the model will not name its gel; give the name with --gel')
    model_id, made = (_of_bags if arguments.bags else _of_dataset)(arguments, progress, command)
    print(f'{arguments.output}: model {model_id}, from {made.presses} presses')
    print(f'form {made.reason}')
    if field := getattr(made, 'field', ''):
        print(f'force field {field}')
    if mounting := getattr(made, 'mounting', ''):
        print(mounting)
    if points := getattr(made, 'curve', ()):
        print('held-out presses read by the force field alone, fitted to:')
    for point in points:
        force, place = point.errors.force_rmse_n, point.errors.place_median_mm
        print(f'{point.presses:5d} presses: force RMSE {force:.4f} N, centre {place:.3f} mm (median); {point.form}')
    for when, errors in (('before', made.before), ('after', made.after)):
        print(f'{when}: force RMSE {errors.force_rmse_n:.4f} N, place {errors.place_median_mm:.3f} mm (median)')
    if made.objection:
        print(f'written because of --force: {made.objection}')
    print(listed(arguments.output, Path(arguments.sensor or '').stem))
    return 0


def _require_used(arguments: argparse.Namespace) -> None:
    """Refuse options that have no effect on these presses, or without any. Raises ConfigurationError."""
    from tactile_nodes.errors import ConfigurationError

    listed = arguments.dataset or arguments.pictures
    for option in ('body', 'curve', 'force'):
        if getattr(arguments, option) and not (arguments.bags or listed):
            raise ConfigurationError(f'--{option} needs presses; leave it out, or give them')
    if arguments.touches and (arguments.bags or listed):
        raise ConfigurationError(
            '--touches goes with --sensor alone; make that model first and calibrate it: what was learnt is kept'
        )
    if arguments.layer and not listed:
        raise ConfigurationError('--layer needs --dataset FILE; leave it out, or make one with: tactile dataset build')
    if arguments.gel and arguments.dataset:
        raise ConfigurationError('--gel does not go with --dataset: the data set names its gel; leave it out')
    if arguments.indenter and not listed:
        raise ConfigurationError('--indenter chooses presses of a data set or a table; leave it out')
    if arguments.untouched_below and not arguments.pictures:
        raise ConfigurationError('--untouched-below needs --pictures CSV; leave it out')
    if arguments.namespace and not arguments.bags:
        raise ConfigurationError('--namespace needs bags; leave it out, or give the bags themselves')


def _pressed(arguments: argparse.Namespace) -> Pressed:
    from tactile_nodes.learning.field.calibration import pressed_by
    from tactile_nodes.model_file import find_model, load_model

    return pressed_by(load_model(find_model(arguments.model)), arguments.sensor or '', arguments.body)


def _of_description(arguments: argparse.Namespace) -> int:
    """A model made from the sensor description alone, without presses."""
    from tactile_nodes.learning.field.calibration import described_model
    from tactile_nodes.learning.field.refining import refine_described, require_touches
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import check_model_output, find_model, load_model
    from tactile_nodes.sensors import load_sensor

    source, progress = find_model(arguments.model), TerminalProgress()
    check_model_output(arguments.output, source, Path(arguments.sensor))
    sensor = load_sensor(arguments.sensor)
    if arguments.touches:
        require_touches(arguments.touches, sensor)
    model_id = described_model(load_model(source), sensor, arguments.gel, arguments.output, progress)
    if arguments.touches:
        model_id = refine_described(arguments.output, arguments.touches, os.cpu_count() or 1, progress)
    print(f'{arguments.output}: model {model_id}, from the description {arguments.sensor} without presses')
    if (off := sensor.gel.moduli_off) > 0:
        print(
            f'its forces may be off by {off:.0%} (gel.moduli_off) until it is calibrated with a few known forces: '
            'docs/sensors.md'
        )
    return 0


def _of_dataset(arguments: argparse.Namespace, progress: Progress, command: str) -> tuple[str, AnyCalibration]:
    """Calibrate from a data set, or from a table of pictures that is turned into one."""
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.calibrating.files import Source, calibrate
    from tactile_nodes.learning.calibrating.hand_presses import presses_by_hand
    from tactile_nodes.learning.datasets.file import load_dataset
    from tactile_nodes.learning.transfer.layer import load_layer_config
    from tactile_nodes.sensing.explain.field.readout import FieldReadout

    source, pressed, forced = Source.find(arguments.model), _pressed(arguments), arguments.force
    if arguments.curve and not isinstance(source.loaded.model.readout, FieldReadout):
        raise ConfigurationError('--curve needs bags, or a model of any contact (field); leave it out')
    layer = load_layer_config(arguments.layer) if arguments.layer else None
    if arguments.dataset:
        recordings = load_dataset(arguments.dataset)
    else:
        recordings = presses_by_hand(
            source.loaded, arguments.pictures, arguments.gel, progress, command, pressed,
            forced=forced, untouched_n=arguments.untouched_below, indenter=arguments.indenter,
        )  # fmt: skip
    return calibrate(
        source, recordings, arguments.output, layer=layer, progress=progress, command=command, forced=forced,
        pressed=pressed, indenter=arguments.indenter, curve=arguments.curve,
    )  # fmt: skip


def _of_bags(arguments: argparse.Namespace, progress: Progress, command: str) -> tuple[str, AnyCalibration]:
    from contextlib import closing

    from tactile_nodes.clock import perf_ns
    from tactile_nodes.learning.calibrating.calibrator import Calibrator, StopRule
    from tactile_nodes.learning.calibrating.files import Source
    from tactile_nodes.learning.calibrating.presses import BagPresses, finish, take_presses, write_calibration
    from tactile_nodes.learning.recorded.building import gel_entry
    from tactile_nodes.sensing.explain.field.readout import FieldReadout

    source, all_of_them = Source.find(arguments.model), StopRule(most=sys.maxsize, worth=0.0)
    # The fits of a curve print one line each; the single fit of all presses shows its own progress.
    fitting = None if arguments.curve else progress
    gel, pressed, curve = gel_entry(arguments.gel), _pressed(arguments), arguments.curve
    readout = source.loaded.model.readout
    tips = not isinstance(readout, FieldReadout) or (readout.tips and (pressed.body is None or pressed.body.is_ball))
    along = curve and bool(tips)
    with closing(
        Calibrator(source.loaded, gel, all_of_them, fitting, pressed, forced=arguments.force, curve=curve)
    ) as calibrator:
        begun_ns = perf_ns()
        with closing(BagPresses(arguments.bags, arguments.namespace, tell=progress.say)) as presses:
            if along:
                take_presses(calibrator, presses, progress.say, command=command)
            else:
                with progress.bar('reading presses', presses.count) as bar:
                    take_presses(calibrator, presses, lambda text: bar.advance(1, text), along=False)
            finish(calibrator, presses, progress.say, command)
        return write_calibration(source, calibrator, arguments.output, begun_ns=begun_ns, command=command)
