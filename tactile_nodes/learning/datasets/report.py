"""The content of a data set as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.recordings import QUALITY, RecordedPresses
from tactile_nodes.learning.datasets.split import KINDS
from tactile_nodes.model_file import size_of_crop

_LABEL = 14


def report(presses: RecordedPresses) -> str:
    """Counts, ranges, methods, the reading of the labels, and presses left out by reason."""
    card = presses.card
    width, height = size_of_crop(card['crop_px'])
    lines = [
        ('fingerprint', presses.fingerprint),
        ('samples', _counts(presses)),
        ('positions', _positions(presses)),
        ('depths', _depths(presses)),
        ('force', _forces(presses)),
        ('labels', card['labels']['reading']),
        ('features', _features(presses)),
        ('images', f'{card["frames"]} of each window, {width}x{height} px'),
        ('gel', card['gel']['id'] or 'not named'),
        ('indenter', ', '.join(name or 'not named' for name in card['indenters'])),
        ('plan', ', '.join(name or 'not named' for name in card['plans'])),
        *_bags(presses),
        ('quality', _quality(presses)),
        *(('split', _split(presses, kind)) for kind in KINDS),
        ('left out', f'{len(card["left_out"])} attempts'),
    ]
    return '\n'.join([*(f'{name:{_LABEL}}{text}' for name, text in lines), *reasons(card['left_out'])])


def reasons(left_out: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line for each reason: its count, and the first case as an example."""
    first = {each['reason']: each for each in reversed(left_out)}
    return [
        f'  {count:>6}  {reason:22}e.g. press {first[reason]["press"]}: {first[reason]["detail"]}'
        for reason, count in Counter(each['reason'] for each in left_out).most_common()
    ]


def _counts(presses: RecordedPresses) -> str:
    touched = int(presses.contact.sum())
    distinct = len(np.unique(presses.press_number))
    return f'{len(presses)}: {touched} of {distinct} presses, {len(presses) - touched} of the untouched gel'


def _positions(presses: RecordedPresses) -> str:
    places = np.unique(np.round(presses.position_mm, 3), axis=0)
    x, y = places.T
    return f'{len(places)}, x {x.min():g} to {x.max():g} mm, y {y.min():g} to {y.max():g} mm'


def _depths(presses: RecordedPresses) -> str:
    known = presses.depth_mm[presses.contact & np.isfinite(presses.depth_mm)]
    if not len(known):
        return 'not known'
    depths, counts = np.unique(np.round(known, 3), return_counts=True)
    if len(depths) > 16:
        return f'{len(depths)} different, {depths[0]:g} to {depths[-1]:g} mm'
    return ', '.join(f'{depth:g} mm ({count})' for depth, count in zip(depths, counts, strict=True))


def _forces(presses: RecordedPresses) -> str:
    force = presses.force_n[presses.contact]
    spread = float(np.median(presses.wrench_deviation[presses.contact, 2]))
    text = f'{force.min():.3f} to {force.max():.3f} N, median {np.median(force):.3f} N'
    return f'{text}; within a window it spreads by {spread:.4f} N (median)' if np.isfinite(spread) else text


def _features(presses: RecordedPresses) -> str:
    rows, cols, channels = presses.features.shape[1:]
    flow, encoding = presses.card['flow'], presses.card['encoding']
    return f'{rows}x{cols}x{channels} of {encoding["name"]} from {_method(flow)}'


def _method(described: Mapping[str, Any]) -> str:
    options = ', '.join(f'{name} {value}' for name, value in described['options'].items() if value is not None)
    return f'{described["name"]} ({options})'


def _bags(presses: RecordedPresses) -> list[tuple[str, str]]:
    lines = []
    for number, (bag, name) in enumerate(zip(presses.card['bags'], presses.card['bag_names'], strict=True)):
        kept = len(np.unique(presses.press_number[presses.bag == number]))
        lines.append(('bag', f'{name} ({bag["id"]}): {kept} presses of {bag["attempts"]} attempts'))
        lines += [('', problem) for problem in bag['problems']]
        lines += [('clock', clock_line(clock)) for clock in bag.get('clocks', [])]
    return lines


def clock_line(clock: Mapping[str, Any]) -> str:
    """A line about a recorder's clock: its offset, its drift, and their uncertainty."""
    if 'refused' in clock:
        return f'{clock["recorder"]}: not known, {clock["edges"]} edges: {clock["why"]}'
    done = 'corrected' if clock['corrected'] else 'agrees, left as it is'
    return (
        f'{clock["recorder"]}: {clock["offset_s"]:+.6f} s, {clock["drift_ppm"]:+.1f} ppm by {clock["matched"]} of '
        f'{clock["edges"]} edges, residuals {clock["residual_median_s"] * 1e3:.2f} ms (median) to '
        f'{clock["residual_max_s"] * 1e3:.2f} ms, known to {clock["bound_s"] * 1e3:.2f} ms; {done}'
    )


def _quality(presses: RecordedPresses) -> str:
    counted = {text: int(((presses.quality & flag) > 0).sum()) for flag, text in QUALITY.items()}
    return ', '.join(f'{count} {text}' for text, count in counted.items() if count) or 'no remarks'


def _split(presses: RecordedPresses, kind: str) -> str:
    try:
        split = presses.split(kind, 1)
    except DatasetError as error:
        return f'by {kind}: {error}'
    parts = f'{len(split.train)} train, {len(split.validation)} validate, {len(split.test)} test'
    return f'by {kind}: {parts} (seed 1, a fifth and a tenth)'
