"""``tactile calibrate``: make a model for another gel from one that exists and a few presses on the new gel."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_nodes.learning.calibrating.files import Made
    from tactile_nodes.learning.field.calibration import Pressed
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.learning.transfer.errors import Point

DESCRIPTION = (
    'Transfer the model of one gel to another (other hardness, markers, thickness or camera) by a few presses on the '
    'new one. All images of a press held still count, and the force over that time. The result is a model file like '
    'any other. `tactile launch calibrate` does the same while a rig presses.'
)
EPILOG = """\
examples:
  tactile calibrate new_gel_bag --model portable --gel gel-7 -o gel-7.safetensors
  tactile calibrate first_bag second_bag --model portable --gel gel-7 -o gel-7.safetensors --curve
  tactile calibrate --dataset new_gel.npz --model portable -o gel-7.safetensors
  tactile calibrate --pictures gel-7.csv --model portable --gel gel-7 -o gel-7.safetensors    # no rig: weights
  tactile calibrate new_gel_bag --model field --gel gel-7 -o gel-7.safetensors --body ball:5
  tactile calibrate punch_bag --model field --gel gel-7 -o gel-7.safetensors --body punch:1.5    # or ring, part.stl
  tactile calibrate --sensor description.yaml --model field -o mine.safetensors  # any contact, before any press
  tactile calibrate --dataset new_gel.npz --model paper -o gel-7.safetensors    # a network: the paper's layer, by torch
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('bags', nargs='*', type=Path, metavar='BAG', help='a bag of presses on the new gel')
    parser.add_argument('--dataset', type=Path, metavar='FILE', help='presses as a data set, instead of bags')
    parser.add_argument('--pictures', type=Path, metavar='CSV', help='presses by hand: a table of pictures')
    parser.add_argument(
        '--untouched-below', type=float, default=0.0, metavar='N',
        help='of pictures: forces up to so much are the gel untouched',
    )  # fmt: skip
    parser.add_argument('--model', required=True, help='the model to begin with: a file, or the name of one that ships')
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='FILE', help='model file to write')
    parser.add_argument(
        '--gel', default='', help='name of the new gel, or the YAML file of a simulated one; a data set names its own'
    )
    parser.add_argument(
        '--curve', action='store_true', help='of bags: also print the error against the number of presses'
    )
    parser.add_argument('--layer', type=Path, metavar='FILE', help="of a network: how the paper's layer is fitted")
    parser.add_argument(
        '--sensor', metavar='YAML', help='of a model of any contact: the description of the sensor, if it is another'
    )
    parser.add_argument(
        '--body', default='', help='of a model of any contact: what pressed, if it is another body: ball:R or punch:R '
        '(radius in mm), or what contact:= of a live launch takes, as ring, part.stl'
    )  # fmt: skip
    parser.add_argument('--indenter', default='', metavar='NAME', help='whose presses count, if there are several')
    parser.add_argument('--namespace', help='of the sensor, if the bags hold several')
    parser.add_argument(
        '--force', action='store_true', help='write the model also if it reads held-out presses no better than before'
    )


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, write the model, and say how much better it is."""
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model
    from tactile_nodes.paths import check_output

    given = sum(map(bool, (arguments.bags, arguments.dataset, arguments.pictures)))
    if not given and arguments.sensor:
        return _of_description(arguments)
    if given != 1:
        raise ConfigurationError(
            'give the presses on the new gel: either bags or --dataset FILE or --pictures CSV, or a --sensor alone'
        )
    _require_used(arguments)
    model = find_model(arguments.model)
    check_output(arguments.output, *arguments.bags, arguments.dataset, arguments.pictures, arguments.layer, model)
    command, progress = shlex.join(['tactile', *sys.argv[1:]]), TerminalProgress()
    if not (arguments.gel or arguments.dataset):
        progress.say('the model will not say which gel it is for; name that with --gel')
    model_id, made = (_of_bags if arguments.bags else _of_dataset)(arguments, progress, command)
    print(f'{arguments.output}: model {model_id}, from {made.presses} presses')
    print(f'form {made.reason}')
    if field := getattr(made, 'field', ''):
        print(f'force field {field}')
    _say_curve(getattr(made, 'curve', ()))
    for when, errors in (('before', made.before), ('after', made.after)):
        print(f'{when}: force RMSE {errors.force_rmse_n:.4f} N, place {errors.place_median_mm:.3f} mm (median)')
    _say_objection(made.objection)
    _list(arguments)
    return 0


def _list(arguments: argparse.Namespace) -> None:
    """Put the calibration onto the list of the lab's gels."""
    from tactile_nodes.learning.calibrating.listing import listed

    print(listed(arguments.output, Path(arguments.sensor or '').stem))


def _say_curve(points: Sequence[Point]) -> None:
    """How the error of the force field falls with the number of presses."""
    if points:
        print('held-out presses read by the force field alone, fitted to:')
    for point in points:
        force, place = point.errors.force_rmse_n, point.errors.place_median_mm
        print(f'{point.presses:5d} presses: force RMSE {force:.4f} N, centre {place:.3f} mm (median); {point.form}')


def _say_objection(objection: str) -> None:
    if objection:
        print(f'written by --force: {objection}')


def _require_used(arguments: argparse.Namespace) -> None:
    """Refuse options that these presses would leave without any effect. Raises ConfigurationError."""
    from tactile_nodes.errors import ConfigurationError

    if arguments.layer and arguments.bags:
        raise ConfigurationError('--layer goes with --dataset FILE; make it of the bags with: tactile dataset build')
    if arguments.gel and arguments.dataset:
        raise ConfigurationError('--gel does not go with --dataset, which names its gel: tactile dataset build … --gel')
    if arguments.indenter and arguments.bags:
        raise ConfigurationError('--indenter chooses presses of a data set or a table; leave it out')
    if arguments.untouched_below and not arguments.pictures:
        raise ConfigurationError('--untouched-below goes with --pictures CSV; leave it out')
    for option in ('curve', 'namespace'):
        if getattr(arguments, option) and not arguments.bags:
            raise ConfigurationError(f'--{option} goes with bags; leave it out, or give the bags themselves')


def _pressed(arguments: argparse.Namespace) -> Pressed:
    from tactile_nodes.learning.field.calibration import pressed_by
    from tactile_nodes.model_file import find_model, load_model

    return pressed_by(load_model(find_model(arguments.model)), arguments.sensor or '', arguments.body)


def _of_description(arguments: argparse.Namespace) -> int:
    """A model that no press has told anything yet."""
    from tactile_nodes.learning.field.calibration import described_model
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.paths import check_output
    from tactile_nodes.sensors import load_sensor

    source = find_model(arguments.model)
    check_output(arguments.output, source, Path(arguments.sensor))
    sensor = load_sensor(arguments.sensor)
    model_id = described_model(load_model(source), sensor, arguments.gel, arguments.output, TerminalProgress())
    print(f'{arguments.output}: model {model_id}, from the description {arguments.sensor} and no press')
    if (off := sensor.gel.moduli_off) > 0:
        print(
            f'its forces may be off by {off:.0%} (gel.moduli_off) until a few known ones calibrate it: docs/sensors.md'
        )
    return 0


def _of_dataset(arguments: argparse.Namespace, progress: Progress, command: str) -> tuple[str, Made]:
    """By a data set, or a table of pictures that becomes one."""
    from tactile_nodes.learning.calibrating.files import Source, calibrate
    from tactile_nodes.learning.calibrating.hand_presses import presses_by_hand
    from tactile_nodes.learning.datasets.file import load_dataset
    from tactile_nodes.learning.transfer.layer import load_layer_config

    source, pressed, forced = Source.find(arguments.model), _pressed(arguments), arguments.force
    layer = load_layer_config(arguments.layer) if arguments.layer else None
    if arguments.dataset:
        recordings = load_dataset(arguments.dataset)
    else:
        recordings = presses_by_hand(
            source.loaded, arguments.pictures, arguments.gel, progress, command, pressed,
            forced=forced, untouched_n=arguments.untouched_below,
        )  # fmt: skip
    return calibrate(
        source, recordings, arguments.output, layer=layer, progress=progress, command=command, forced=forced,
        pressed=pressed, indenter=arguments.indenter,
    )  # fmt: skip


def _of_bags(arguments: argparse.Namespace, progress: Progress, command: str) -> tuple[str, Made]:
    from contextlib import closing

    from tactile_nodes.learning.calibrating.calibrator import Calibrator, StopRule
    from tactile_nodes.learning.calibrating.files import Source
    from tactile_nodes.learning.calibrating.presses import BagPresses, Written, finish, take_presses
    from tactile_nodes.learning.recorded.building import gel_told
    from tactile_nodes.sensing.explain.field.readout import FieldReadout

    source, all_of_them = Source.find(arguments.model), StopRule(most=sys.maxsize, worth=0.0)
    # The fits of a curve are told in a line each; the one fit of all presses shows its own progress.
    fitting = None if arguments.curve else progress
    gel, pressed, curve = gel_told(arguments.gel), _pressed(arguments), arguments.curve
    readout = source.loaded.model.readout
    tips = not isinstance(readout, FieldReadout) or (readout.tips and (pressed.body is None or pressed.body.is_ball))
    along = curve and bool(tips)
    with closing(
        Calibrator(source.loaded, gel, all_of_them, fitting, pressed, forced=arguments.force, curve=curve)
    ) as calibrator:
        written = Written(source, calibrator, command, progress, pressed, forced=arguments.force, curve=curve)
        with closing(BagPresses(arguments.bags, arguments.namespace, tell=progress.say)) as presses:
            if along:
                take_presses(calibrator, presses, progress.say, command=command)
            else:
                with progress.bar('reading presses', presses.count) as bar:
                    take_presses(calibrator, presses, lambda text: bar.advance(1, text), along=False)
            finish(calibrator, presses, progress.say, command)
        model_id = written.to(arguments.output)
    assert written.made is not None
    return model_id, written.made
