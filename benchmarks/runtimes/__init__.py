"""Compare NumPy, ONNX Runtime and PyTorch: one frame at a time, one thread, the frames that `evaluate` uses.

Each runtime runs in a separate process. They run in turn, forwards and backwards, so that other load on the machine
affects all alike. PyTorch computes only the network; NumPy and ONNX Runtime also compute place, uncertainty and
novelty.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.harness.declaration import SENSING, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.report import in_turn, opening, quartiles, ranged, table
from benchmarks.harness.running import Run
from benchmarks.harness.workers import environment
from benchmarks.runtimes.ends import BEGIN, Runtime
from benchmarks.runtimes.sizes import installed_size
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.explain.network import NetworkReadout

ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1'}
PACKAGES = ('numpy', 'onnxruntime', 'onnx', 'torch')
INTRODUCTION = """\
One frame at a time on one thread. Each runtime runs in a separate process; all process the same simulated frames in
turn. *inference* is the time from features to forces: median of the rounds' medians, with interquartile range. *CPU* is
the median of the rounds' mean CPU time per frame. *ratio* is relative to NumPy in the same round. *start* is the time
to the first result, from a process that has only the imports of the live node; *memory* is the growth of the process
until then. NumPy and ONNX Runtime compute the whole result (forces, place, uncertainty, novelty), PyTorch only the
forces of a network. The machine had other load, so CPU times and ratios are more reliable than times."""
AGREEMENT = """\
Largest differences between the exported model and the original over all frames, with the confidence of the regions as
it is, and with 5 % of the regions lost at random. An export reports one contact, and is compared with the original
limited to one contact. *several* counts frames in which the original would report more, and how many of those the
export flags."""


@dataclass(frozen=True)
class Effort:
    """The amount of measurements."""

    frames: int = 200
    rounds: int = 60
    turn: int = 20


QUICK = Effort(frames=10, rounds=2, turn=5)
EXPORTED = 'paper', 'fast'


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the named models, or those that ship and can be exported."""
    files = [find_model(name) for name in arguments.model or EXPORTED]
    return measure(files, QUICK if arguments.quick else Effort(), run.progress, run.part)


def measure(files: Sequence[Path], effort: Effort, progress: Progress, part: Part = at_once) -> Result:
    """All numbers of the page.

    Raises:
        ConfigurationError: onnx or onnxruntime is not installed, or two models have the same name.
        ModelError: a model cannot be used, or was not trained on simulated presses.
    """
    if len({file.stem for file in files}) < len(files):
        raise ConfigurationError('two models have the same file name, by which tables call them; rename one')
    sizes = {name: installed_size(name) for name in PACKAGES}
    torch = sizes.get('torch') is not None
    models = {
        file.stem: part(file.stem, partial(_measure_model, file, effort, progress, torch=torch)) for file in files
    }
    return {'effort': asdict(effort), 'packages': sizes, 'models': models}


def _measure_model(file: Path, effort: Effort, progress: Progress, *, torch: bool) -> dict[str, Any]:
    from tactile_nodes.learning.onnx_files.check import compare, frames, real_samples
    from tactile_nodes.learning.onnx_files.export import onnx_bytes

    loaded = load_model(file)
    content, samples = onnx_bytes(loaded), real_samples(loaded, effort.frames, progress)
    shown = frames(loaded, samples)
    chosen = [name for name in BEGIN if name != 'torch' or (torch and isinstance(loaded.model.readout, NetworkReadout))]
    with tempfile.TemporaryDirectory() as folder, environment(**ONE_THREAD), contextlib.ExitStack() as stack:
        exported = Path(folder) / 'model.onnx'
        exported.write_bytes(content)
        workers = {name: Runtime(name, file, exported, shown) for name in chosen}
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


def _take_turns(workers: Mapping[str, Runtime], effort: Effort, progress: Progress) -> dict[str, Any]:
    """Run the runtimes in turn, in reversed order every other round; the first round is a warm-up."""
    turns: dict[str, list[tuple[float, float]]] = {name: [] for name in workers}
    with progress.bar('taking turns', effort.rounds + 1) as bar:
        for number in range(effort.rounds + 1):
            for name in in_turn(list(workers), number):
                turns[name].append(workers[name].turn(number * effort.turn, effort.turn))
            bar.advance()
    wall = {name: [each[0] for each in taken[1:]] for name, taken in turns.items()}
    return {
        name: {
            'answer_ms': quartiles(wall[name]),
            'cpu_ms': quartiles([each[1] for each in turns[name][1:]]),
            'ratio': quartiles([own / first for own, first in zip(wall[name], wall['numpy'], strict=True)]),
            **worker.began,
        }
        for name, worker in workers.items()
    }


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    others = {name: each for name, each in result['packages'].items() if each and name != 'numpy'}
    packages = ', '.join(f'{name} {each["version"]}' for name, each in others.items())
    effort = result['effort']
    before = max(one['memory_before_mb'] for each in result['models'].values() for one in each['runtimes'].values())
    more = (
        f'{packages}; {effort["rounds"]} rounds of {effort["turn"]} of {effort["frames"]} frames. Processes had '
        f'{before:.0f} MB before their runtime'
    )
    parts = [*opening('numpy, onnxruntime and torch', result, INTRODUCTION, more), _times(result['models'])]
    parts += ['## Size', _sizes(result['packages']), '## Agreement', AGREEMENT, _agreement(result['models'])]
    return '\n\n'.join(parts)


def _times(models: Mapping[str, Any]) -> str:
    heads = ['model', 'runtime', 'inference [ms]', 'CPU [ms]', 'ratio', 'start [s]', 'memory [MB]']
    rows = [
        [
            f'{model} ({each["readout"]}, {each["parameters"]} numbers)', name, ranged(one['answer_ms']),
            f'{one["cpu_ms"]["median"]:.2f}', ranged(one['ratio']), f'{one["start_s"]:.2f}', f'{one["memory_mb"]:.0f}',
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
    return table(['package', 'needed', 'alone [MB]', 'with dependencies [MB]'], rows)


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


BENCHMARK = Benchmark(
    name='runtimes',
    about=__doc__,
    sources=('benchmarks/runtimes/**', 'tactile_nodes/learning/onnx_files/**', *SENSING),
    page=page,
    measure=measured,
    quick=True,
    arguments=(
        argument(
            'model', nargs='*', help=f'model files, or names of models that ship (default: {", ".join(EXPORTED)})'
        ),
    ),
)
