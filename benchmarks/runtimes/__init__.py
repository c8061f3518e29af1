"""Numpy, onnxruntime and torch side by side: one frame at a time, one thread, the frames that `evaluate` takes.

Every runtime answers in a process of its own, and all take turns, forwards and backwards, so that the machine's load
meets all of them. Torch computes the network alone; numpy and onnxruntime answer with place, uncertainty and likeness.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import keep, surroundings, table
from benchmarks.runtimes.ends import BEGIN, Worker
from benchmarks.runtimes.sizes import installed_size
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress, TerminalProgress
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.paths import share_directory
from tactile_nodes.sensing.explain.network import NetworkReadout

ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1'}
PACKAGES = ('numpy', 'onnxruntime', 'onnx', 'torch')
INTRODUCTION = """\
One frame at a time on one thread, every runtime in a process of its own, all taking turns on the same simulated
frames. *answer* is from features to forces: the median of the rounds' medians, and the range of their middle half;
*CPU* is the median of the rounds' mean CPU times of a frame; *ratio* is to numpy in the same round. *begin* is from
nothing but what the live node imports anyway to the first answer, *memory* what the process grew by then. Numpy and
onnxruntime give the whole answer (forces, place, uncertainty, likeness), torch the forces of a network alone. The
machine was shared while this ran, so CPU times and ratios say more than times."""
AGREEMENT = """\
Largest differences between the exported model and the original over all frames, with the regions' confidence as it is
and with 5 % of the regions lost at random. An export names one contact, and is compared with the original that names
one; `several` counts frames in which the original would have named more, and how many of those the export flags."""


@dataclass(frozen=True)
class Effort:
    """How much to measure."""

    frames: int = 200
    rounds: int = 60
    turn: int = 20


QUICK = Effort(frames=10, rounds=2, turn=5)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench runtimes``."""
    parser.add_argument('model', nargs='*', help='model files, or names of models that ship (default: all that ship)')
    parser.add_argument('--quick', action='store_true', help='a few frames, to see that it runs; too few to quote')
    parser.add_argument('-o', '--output', type=Path, metavar='FOLDER', help='write runtimes.json and runtimes.md there')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    shipped = sorted((share_directory() / 'models').glob('*.safetensors'))
    files = [find_model(name) for name in arguments.model] or shipped
    result = measure(files, QUICK if arguments.quick else Effort(), TerminalProgress(), _command(arguments))
    text = page(result)
    print(text)
    if arguments.output:
        keep(arguments.output, 'runtimes', text, result)
    return 0


def measure(
    files: Sequence[Path], effort: Effort, progress: Progress, command: str = 'tactile bench runtimes'
) -> dict[str, Any]:
    """All numbers of the page.

    Raises:
        ConfigurationError: onnx or onnxruntime is not installed, or two models have one name.
        ModelError: a model cannot be used, or was not trained on simulated presses.
    """
    if len({file.stem for file in files}) < len(files):
        raise ConfigurationError('two models have the same file name, by which tables call them; rename one')
    sizes = {name: installed_size(name) for name in PACKAGES}
    about = surroundings(command)
    models = {file.stem: _measure_model(file, effort, progress, torch=sizes.get('torch') is not None) for file in files}
    return {**about, 'effort': asdict(effort), 'packages': sizes, 'models': models}


def _measure_model(file: Path, effort: Effort, progress: Progress, *, torch: bool) -> dict[str, Any]:
    from tactile_nodes.learning.onnx_files.check import compare, frames, real_samples
    from tactile_nodes.learning.onnx_files.export import onnx_bytes

    loaded = load_model(file)
    content, samples = onnx_bytes(loaded), real_samples(loaded, effort.frames, progress)
    shown = frames(loaded, samples)
    chosen = [name for name in BEGIN if name != 'torch' or (torch and isinstance(loaded.model.readout, NetworkReadout))]
    with tempfile.TemporaryDirectory() as folder, _one_thread(), contextlib.ExitStack() as stack:
        exported = Path(folder) / 'model.onnx'
        exported.write_bytes(content)
        workers = {name: Worker(name, file, exported, shown) for name in chosen}
        for each in workers.values():
            stack.callback(each.close)
        runtimes = _take_turns(workers, effort, progress)
    return {
        **_about(loaded, file, len(content)),
        'runtimes': runtimes,
        'differences': {
            'as they are': asdict(compare(loaded, content, shown)),
            '5 % lost': asdict(compare(loaded, content, frames(loaded, samples, 0.05))),
        },
    }


def _about(loaded: LoadedModel, file: Path, exported: int) -> dict[str, Any]:
    return {
        'model_id': loaded.model_id,
        'readout': loaded.model.readout.kind,
        'parameters': loaded.model.readout.parameter_count,
        'file_mb': file.stat().st_size / 1e6,
        'onnx_mb': exported / 1e6,
    }


def _take_turns(workers: Mapping[str, Worker], effort: Effort, progress: Progress) -> dict[str, Any]:
    """Each in its turn, every round in the opposite order of the one before; the first round warms up."""
    turns: dict[str, list[tuple[float, float]]] = {name: [] for name in workers}
    with progress.bar('taking turns', effort.rounds + 1) as bar:
        for number in range(effort.rounds + 1):
            for name in list(workers)[:: 1 if number % 2 else -1]:
                turns[name].append(workers[name].turn(number * effort.turn, effort.turn))
            bar.advance()
    wall = {name: [each[0] for each in taken[1:]] for name, taken in turns.items()}
    return {
        name: {
            'answer_ms': _quartiles(wall[name]),
            'cpu_ms': _quartiles([each[1] for each in turns[name][1:]]),
            'ratio': _quartiles([own / first for own, first in zip(wall[name], wall['numpy'], strict=True)]),
            **worker.began,
        }
        for name, worker in workers.items()
    }


def _quartiles(values: Sequence[float]) -> dict[str, float]:
    """Median, and the range of the middle half: on a shared machine the extremes are other people's."""
    low, median, high = np.percentile(values, (25, 50, 75)).tolist()
    return {'median': median, 'low': low, 'high': high}


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """The environment for processes whose libraries shall use one thread, which they read when they are loaded."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    machine, versions = result['machine'], result['versions']
    packages = ', '.join(f'{name} {each["version"]}' for name, each in result['packages'].items() if each)
    effort = result['effort']
    before = max(one['memory_before_mb'] for each in result['models'].values() for one in each['runtimes'].values())
    about = (
        f'{machine["processor"]}, {machine["cores"]} cores, load before {machine["load_before"][0]:g}; commit '
        f'{result["commit"]}; python {versions["python"]}, {packages}; {effort["rounds"]} rounds of {effort["turn"]} '
        f'of {effort["frames"]} frames. Processes had {before:.0f} MB before their runtime.'
    )
    return '\n\n'.join(
        [
            '# numpy, onnxruntime and torch', f'```console\n$ {result["command"]}\n```', INTRODUCTION, about,
            _times(result['models']), '## Size', _sizes(result['packages']), '## The same answers', AGREEMENT,
            _agreement(result['models']),
        ]
    )  # fmt: skip


def _times(models: Mapping[str, Any]) -> str:
    heads = ['model', 'runtime', 'answer [ms]', 'CPU [ms]', 'ratio', 'begin [s]', 'memory [MB]']
    rows = [
        [
            f'{model} ({each["readout"]}, {each["parameters"]} numbers)', name, _range(one['answer_ms']),
            f'{one["cpu_ms"]["median"]:.2f}', _range(one['ratio']), f'{one["start_s"]:.2f}', f'{one["memory_mb"]:.0f}',
        ]
        for model, each in models.items() for name, one in each['runtimes'].items()
    ]  # fmt: skip
    return table(heads, rows)


def _sizes(packages: Mapping[str, Any]) -> str:
    words = {
        'numpy': 'yes',
        'onnxruntime': 'to run an export',
        'onnx': 'to make an export',
        'torch': 'to train networks',
    }
    rows = [
        [f'{name} {each["version"]}', words[name], f'{each["alone_mb"]:.0f}', f'{each["with_what_it_brings_mb"]:.0f}']
        for name, each in packages.items() if each
    ]  # fmt: skip
    return table(['installed', 'needed', 'alone [MB]', 'with what it brings [MB]'], rows)


def _agreement(models: Mapping[str, Any]) -> str:
    heads = ['model', 'regions', 'a bin [mN]', 'place [mm]', 'force [mN]', 'sigmas', 'unlikeness', 'several, flagged']
    rows = [
        [
            model, which, f'{each["bin_n"] * 1e3:.1g}', f'{each["place_mm"]:.1g}', f'{each["force_n"] * 1e3:.1g}',
            f'{each["sigma_share"]:.1g}', f'{each["unlikeness_share"]:.1g}',
            f'{each["several"]}, {each["several_flagged"]}',
        ]
        for model, found in models.items() for which, each in found['differences'].items()
    ]  # fmt: skip
    return table(heads, rows)


def _range(found: Mapping[str, float]) -> str:
    return f'{found["median"]:.2f} ({found["low"]:.2f} to {found["high"]:.2f})'


def _command(arguments: argparse.Namespace) -> str:
    words = ['tactile bench runtimes', *arguments.model, *['--quick'] * arguments.quick]
    return ' '.join([*words, *(['-o', str(arguments.output)] if arguments.output else [])])
