"""Error and bias of all methods to measure motion, against the size of the motion.

Three kinds of images: the rest image moved as a whole by 0.02 to 30 px; simulated presses, whose true motion is known
in each region; and synthetic speckle images, if they are there. The methods are those of `tactile bench front`, in turn
on each image. Patches are on 20x20 regions; dense motion is averaged over regions.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.flow.cases import Case, Sensor, known_shifts, pressed, rigid
from benchmarks.flow.errors import Errors, errors_of
from benchmarks.front.contenders import WAYS, Way, one_thread
from benchmarks.front.flows import SmallPixels
from benchmarks.harness.declaration import SIMULATED, Benchmark, Result, argument
from benchmarks.harness.report import opening, table
from benchmarks.harness.running import Run
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.flow.methods import FlowMethod

if TYPE_CHECKING:
    from collections.abc import Callable

REGIONS = 20
SIZES_PX = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
BANDS_PX = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Limits of the groups by size of true motion under simulated presses."""
INTRODUCTION = """\
Root mean square error of a region along each axis in px; in brackets the bias, which is the mean error along the true
motion (negative: underestimated). One thread, all methods in turn on every image. Patches are on 20x20 regions; dense
motion is averaged over regions. *CPU* is the median time for the frames moved by 2 px."""
PRESSES = """\
Simulated presses to 2 mm; regions are grouped by the true mean motion of their markers. Markers near the camera are
brighter and move less than those above them. So the motion in the picture is less than the mean of the markers, and all
methods underestimate it."""


def flow_ways() -> list[Way]:
    """The methods of the chart that measure motion."""
    return [way for way in WAYS if way.make is not SmallPixels]


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the methods chosen on the command line."""
    asked = arguments.only or ''
    ways = [way for way in flow_ways() if asked in way.name and (arguments.slow or not way.slow)]
    if not ways:
        raise ConfigurationError(f'no way is called {asked!r}; there are: {", ".join(w.name for w in flow_ways())}')
    return measure(ways, arguments.frames, arguments.presses, arguments.speckle, run.progress)


def measure(ways: Sequence[Way], frames: int, presses: int, speckle: Path | None, progress: Progress) -> Result:
    """All numbers of the page.

    Raises:
        ConfigurationError: the folder `speckle` lacks the images.
    """
    shifted = known_shifts(speckle) if speckle else {}
    one_thread()
    flows = {way.name: _flow(way.make, REGIONS if REGIONS in way.grids else way.grids[0]) for way in ways}

    def of_each(sets: Mapping[str, Iterable[Case]]) -> dict[str, dict[str, Errors]]:
        return {name: errors_of(flows, cases, REGIONS) for name, cases in _with_progress(sets, progress)}

    sensor, together = Sensor(), {name: Errors() for name in flows}
    moved = of_each(rigid(sensor, frames, SIZES_PX))
    for found in of_each(pressed(sensor, presses)).values():
        for name, each in found.items():
            together[name].add(each)
    bands = {f'{low:g} to {high:g} px': (low, high) for low, high in itertools.pairwise(BANDS_PX)}
    result = {
        'moved': _summaries(moved),
        'pressed': {
            name: {way: each.along_motion(*band) for way, each in together.items()} for name, band in bands.items()
        },
    }
    if shifted:
        result['speckle'] = _summaries(of_each(shifted))
    times = {name: float(np.median(each.cpu_ms)) for name, each in moved['moved by 2 px'].items()}
    return {'threads': 1, 'sizes_px': SIZES_PX, 'cpu_ms': times, **result}


def _summaries(sets: Mapping[str, Mapping[str, Errors]]) -> dict[str, dict[str, dict[str, float]]]:
    return {name: {way: each.along_motion() for way, each in found.items()} for name, found in sets.items()}


def _with_progress(sets: Mapping[str, Iterable[Case]], progress: Progress) -> Iterable[tuple[str, Iterable[Case]]]:
    with progress.bar('measuring motion', len(sets)) as bar:
        for name, cases in sets.items():
            yield name, cases
            bar.advance(1, name)


def _flow(make: Callable[[int], FlowMethod | SmallPixels], regions: int) -> FlowMethod:
    made = make(regions)
    assert not isinstance(made, SmallPixels)
    return made


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    parts = opening('Accuracy of the measured motion', result, INTRODUCTION, f'{result["threads"]} thread')
    moved = {name.removeprefix('moved by '): each for name, each in result['moved'].items()}
    parts += ['## The rest image, moved as a whole', _table(moved, result['cpu_ms'])]
    parts += ['## Under simulated presses', PRESSES, _table(result['pressed'])]
    if 'speckle' in result:
        speckle = {name.removeprefix('speckle moved by '): each for name, each in result['speckle'].items()}
        parts += ['## Speckle images of another project', _table(speckle)]
    return '\n\n'.join([*parts, '![error against motion](motion.png)'])


def _table(sets: Mapping[str, Mapping[str, Mapping[str, float]]], cpu_ms: Mapping[str, float] | None = None) -> str:
    """A row for each method, a column for each set."""
    names = next(iter(sets.values()))
    rows = [
        [name, *([f'{cpu_ms[name]:.2f}'] if cpu_ms else []), *(_cell(found[name]) for found in sets.values())]
        for name in names
    ]
    return table(['method', *(['CPU [ms]'] if cpu_ms else []), *sets], rows)


def _cell(summary: Mapping[str, float]) -> str:
    return f'{summary["rms_px"]:.3f} ({summary["bias_px"]:+.3f})' if summary['regions'] else '-'


def draw(result: Mapping[str, Any], folder: Path, name: str) -> None:
    """Plot error and bias of each method against the motion of the whole picture."""
    from tactile_nodes.learning.figures import figure, save

    drawn = figure(13.0, 5.5)
    axes = drawn.subplots(1, 2)
    for number, way in enumerate(result['cpu_ms']):
        style = ('-', '--')[number // 10 % 2]  # there are ten colours
        found = [each[way] for each in result['moved'].values()]
        axes[0].loglog(result['sizes_px'], [max(each['rms_px'], 1e-4) for each in found], f'.{style}', label=way)
        shares = [each['bias_px'] / size for each, size in zip(found, result['sizes_px'], strict=True)]
        axes[1].semilogx(result['sizes_px'], shares, f'.{style}')
    axes[0].set(xlabel='motion [px]', ylabel='rms error of a region [px]')
    axes[1].set(xlabel='motion [px]', ylabel='bias, as a share of the motion', ylim=(-1.05, 0.5))
    axes[0].legend(fontsize=6, ncols=2)
    for axis in axes:
        axis.grid(which='both', linewidth=0.3)
    drawn.suptitle('the rest image moved as a whole')
    save(drawn, folder / f'{name}.png')


BENCHMARK = Benchmark(
    name='motion',
    about=__doc__,
    sources=('benchmarks/motion.py', 'benchmarks/flow/**', 'tactile_nodes/sensing/flow/**', *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    arguments=(
        argument('--frames', least=1, type=int, default=3, help='images for each size of motion (default: 3)'),
        argument('--presses', least=1, type=int, default=12, help='simulated presses for each range (default: 12)'),
        argument('--speckle', type=Path, help='folder with the shifted speckle images of dic_rigid_shift'),
        argument('--only', metavar='TEXT', help='only methods whose name contains this'),
        argument('--slow', action='store_true', help='with methods that take hundreds of ms per frame (TV-L1)'),
    ),
)
