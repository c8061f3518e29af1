"""``tactile calibrate``: make a model for another gel from one that exists and a few presses on the new gel."""

from __future__ import annotations

import argparse
from pathlib import Path

DESCRIPTION = (
    'Transfer the response model of one gel to another (other hardness, markers, thickness or camera) by a few '
    'presses on the new one. The result is a model file like any other.'
)
EPILOG = """\
example:
  tactile dataset build new_gel_bag -o new_gel.npz
  tactile calibrate --model fast --dataset new_gel.npz -o new_gel.safetensors
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('--model', required=True, help='a response model: a file, or the name of one that ships')
    parser.add_argument('--dataset', required=True, type=Path, metavar='FILE', help='presses on the new gel')
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='FILE', help='model file to write')


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, write the model, and say how much better it is."""
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.learning.transfer import calibrate
    from tactile_nodes.model_file import find_model

    command = f'tactile calibrate --model {arguments.model} --dataset {arguments.dataset} -o {arguments.output}'
    model_id, made = calibrate(
        find_model(arguments.model), arguments.dataset, arguments.output, progress=TerminalProgress(), command=command
    )
    print(f'{arguments.output}: model {model_id}, from {made.presses} presses')
    print(f'form {made.reason}')
    for when, errors in (('before', made.before), ('after', made.after)):
        print(f'{when}: force RMSE {errors.force_rmse_n:.4f} N, place {errors.place_median_mm:.3f} mm (median)')
    return 0
