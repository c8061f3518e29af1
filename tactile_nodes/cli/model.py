"""``tactile model``: show or export a trained model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.model_file import LoadedModel

DESCRIPTION = 'Show the card of a trained force model, or export the model.'
EPILOG = """\
examples:
  tactile model info fast                         its training data, gel, scores and licence
  tactile model export fast                       fast.onnx, for onnxruntime and others
  tactile model export fast -o gel.onnx --check   and compare it with the original on 200 frames
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest='what', required=True, metavar='what')
    info = verbs.add_parser('info', help="print a model's card")
    info.add_argument('model', help='a model file, or the name of a shipped model')
    info.set_defaults(action=_info)
    export = verbs.add_parser('export', help='write a model as ONNX')
    export.set_defaults(action=_export)
    export.add_argument('model', help='a model file, or the name of a shipped model')
    export.add_argument('-o', '--output', type=Path, metavar='FILE', help='file to write (default: NAME.onnx, here)')
    export.add_argument(
        '--check', type=int, nargs='?', const=200, default=0, metavar='N',
        help='compare it with the original on N simulated frames (200); needs onnxruntime',
    )  # fmt: skip


def _info(arguments: argparse.Namespace) -> int:
    """The card as YAML: flow, features, data, gel, training, scores, units, licence."""
    import yaml

    from tactile_nodes.model_file import find_model, load_model

    loaded = load_model(find_model(arguments.model))
    card = {'model_id': loaded.model_id, **loaded.card}
    print(yaml.safe_dump(card, sort_keys=False, allow_unicode=True, width=120), end='')
    return 0


def _export(arguments: argparse.Namespace) -> int:
    """Write the file, print what it holds, and check it if asked."""
    from tactile_nodes.learning.onnx_files.export import export_onnx
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.paths import check_output

    found = find_model(arguments.model)
    loaded, file = load_model(found), arguments.output or Path(f'{found.stem}.onnx')
    check_output(file, found)
    size = export_onnx(loaded, file)
    print(f'{file}: {loaded.model.readout.kind} readout of model {loaded.model_id}, {size / 1e6:.1f} MB')
    if getattr(loaded.model.readout, 'most_contacts', 1) > 1:
        print('it reports one contact; for frames with several contacts it reports the best fit and sets the flag')
    if arguments.check:
        _check(loaded, file, arguments.check)
    return 0


def _check(loaded: LoadedModel, file: Path, count: int) -> None:
    from tactile_nodes.errors import ConfigurationError
    from tactile_nodes.learning.onnx_files.check import compare, frames, real_samples
    from tactile_nodes.learning.progress import TerminalProgress

    if count < 1:
        raise ConfigurationError(f'--check must be at least 1, got {count}')
    samples = real_samples(loaded, count, TerminalProgress())
    for words, lost_share in (('as they are', 0.0), ('with 5 % of the regions lost', 0.05)):
        found = compare(loaded, file.read_bytes(), frames(loaded, samples, lost_share))
        print(
            f'largest differences from the original over {found.samples} frames {words}: '
            f'{found.bin_n * 1e3:.2g} mN in a bin, {found.place_mm * 1e3:.2g} um, {found.force_n * 1e3:.2g} mN total, '
            f'{found.sigma_share:.1e} of a sigma, {found.unlikeness_share:.1e} of the novelty'
        )
        if found.several:
            print(f'the original reports several contacts in {found.several} of them; flagged: {found.several_flagged}')
