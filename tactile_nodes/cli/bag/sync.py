"""`tactile bag sync`: compare the clocks of a bag's recorders by the edges that all of them saw."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_nodes.learning.recorded.clocks import Clocks

DESCRIPTION = (
    'Fit the clock of each recorder in a bag to the clock of the machine, by the edges of the digital line. The exit '
    'status is 1 if a clock cannot be fitted, or if no recorder other than the machine saw the line.'
)
_COLUMNS = ('edges', 'matched', 'offset [s]', 'drift [ppm]', 'median [ms]', 'largest [ms]', 'known to [ms]')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bag', type=Path, help='a folder, a .mcap file or a .db3 file')
    parser.add_argument('--reference', metavar='RECORDER', help="fit to this recorder's clock (default: the machine)")
    parser.add_argument('--namespace', help='namespace of the sensor, if the bag holds several')
    parser.add_argument('--picture', type=Path, metavar='FILE.png', help='draw the residuals of the fits')
    parser.set_defaults(action=run)


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.bag.reader import BagReader
    from tactile_nodes.learning.recorded.clocks import bag_clocks

    with BagReader(arguments.bag) as reader:
        clocks = bag_clocks(reader, arguments.namespace, arguments.reference)
    print('\n'.join(lines(clocks)))
    if arguments.picture:
        from tactile_nodes.learning.recorded.clocks_picture import draw

        draw(clocks, arguments.picture)
        print(f'wrote {arguments.picture}')
    return 0 if clocks.others and not clocks.warnings else 1


def lines(clocks: Clocks) -> list[str]:
    """A table of the fitted clocks, and a sentence for each clock that could not be fitted."""
    recorders = clocks.as_list()
    if not recorders:
        return [f'only {clocks.reference} saw the {len(clocks.shared)} edges of the line: there is nothing to compare']
    fitted = [clock for clock in recorders if 'refused' not in clock]
    wide = max(len('recorder'), *(len(clock['recorder']) for clock in recorders))
    head = (
        f'fitted to {clocks.reference}, {len(clocks.shared)} edges; offset: what stamps lack in the middle of the run'
    )
    rows = [_row(clock['recorder'], _numbers(clock), wide) for clock in fitted]
    refused = [
        f'{clock["recorder"]}: {clock["edges"]} edges, {clock["refused"]}: {clock["why"]}'
        for clock in recorders
        if 'refused' in clock
    ]
    return [head, *([_row('recorder', _COLUMNS, wide), *rows] if rows else []), *refused]


def _numbers(clock: dict[str, Any]) -> list[str]:
    milliseconds = (f'{clock[name] * 1e3:.3f}' for name in ('residual_median_s', 'residual_max_s', 'bound_s'))
    offset, drift = f'{clock["offset_s"]:+.6f}', f'{clock["drift_ppm"]:+.2f}'
    return [str(clock['edges']), str(clock['matched']), offset, drift, *milliseconds]


def _row(name: str, values: Sequence[str], wide: int) -> str:
    return name.ljust(wide) + ''.join(f'{value:>15}' for value in values)
