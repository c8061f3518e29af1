"""Snapshots as text: in colour for a terminal, as one line, and as the summary at the end."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

from rich.style import Style
from rich.text import Text

from tactile_nodes.bus.topics import FORCE_DISTRIBUTION
from tactile_nodes.cli.view import FULL_SCALE_N
from tactile_nodes.cli.view.map import MAP_WIDTH, map_lines
from tactile_nodes.viewing.measures import STAGES, Scores, strongest
from tactile_nodes.viewing.net import net_of
from tactile_nodes.viewing.state import OLD_S, NodeHealth, Snapshot, complaint, reason_names, silent

BOLD, _DIM, _PLAIN = Style(bold=True), Style(dim=True), Style()
LEVELS = (Style(color='green'), Style(color='yellow'), Style(color='red', bold=True), Style(color='magenta'))
_LEVEL_NAMES = ('ok', 'warning', 'error', 'stale')
_STATUSES = ('OK', 'DEGRADED', 'INVALID')
_WAYS = '→↘↓↙←↖↑↗'  # from +x (right) towards +y (down)


def picture(shot: Snapshot, full_scale_n: float = FULL_SCALE_N) -> Text:
    lines = [_title(shot), Text()]
    if shot.force is None:
        lines.append(Text(waiting(shot), LEVELS[1]))
    else:
        lines += _side_by_side(map_lines(shot.force, _true_bin(shot), full_scale_n), _latency_lines(shot))
        lines += [Text(), _force_line(shot), _place_line(shot), *_net_lines(shot)]
        lines += [_counts_line(shot), _provenance_line(shot)]
    lines += health_lines(shot)
    lines += [Text(line, LEVELS[1]) for line in shot.logs]
    text = Text('\n').join(lines)
    text.no_wrap, text.overflow = True, 'ellipsis'
    return text


def line(shot: Snapshot) -> str:
    """The view as one line, for a log or a pipe."""
    head = f'{shot.running_s:7.1f} s'
    if shot.force is None:
        return f'{head}  {waiting(shot)}'
    total = shot.latencies['end to end']
    parts = [
        head,
        f'{hz(shot.arrivals_hz):>5} fps',
        _total_text(shot),
        _place_text(shot),
        *filter(None, [net_text(shot.force)]),
        f'capture to here p50 {milliseconds(total.p50)} p99 {milliseconds(total.p99)} ms',
        f'lost {shot.lost} skipped {shot.skipped}',
        state_text(shot),
    ]
    complaints = [complaint(shot)] if is_old(shot) else []
    return '  '.join(filter(None, [*parts, *complaints]))


def pages(shot: Snapshot) -> list[str]:
    """Where the live view is shown in a browser, by the diagnostics of its node."""
    return [entry.text.partition(',')[0] for entry in shot.health if entry.text.startswith('page: ')]


def waiting(shot: Snapshot) -> str:
    """What is missing while there is no force."""
    topic = _topic(shot)
    if not shot.estimators:
        return f'no force yet: {topic} has no publisher; {shot.advice}'
    reports = '; '.join(f'{entry.node}: {entry.text or _LEVEL_NAMES[entry.level]}' for entry in _by_level(shot.health))
    return (
        f'no force yet: {", ".join(shot.estimators)} is waiting; is a camera running? Diagnostics: {reports or "none"}'
    )


def summary(shot: Snapshot) -> str:
    """The text that is printed at the end; `shot` covers the whole run."""
    if shot.frames == 0:
        return f'{shot.running_s:.1f} s; {waiting(shot)}'
    lines = [
        f'{shot.frames} frames in {shot.running_s:.1f} s, the first after {shot.first_after_s:.1f} s; '
        f'{hz(shot.arrivals_hz)} fps arriving, {hz(shot.stamps_hz)} by stamps',
        f'{_drops_text(shot)}; {shot.invalid} invalid, {shot.malformed} malformed',
        'latency [ms]   p50     p99',
        *(
            f'  {stage:<10} {milliseconds(found.p50):>6}  {milliseconds(found.p99):>6}'
            for stage, found in shot.latencies.items()
        ),
        *_score_lines(shot.scores),
    ]
    return '\n'.join(lines)


def _score_lines(scores: Scores) -> list[str]:
    if not scores.pairs:
        return ['no true force for comparison']
    lines = [f'total force against the true force: RMSE {scores.rmse_n:.4f} N over {scores.pairs} frames']
    if scores.contact_pairs:
        lines.append(f'peak in the true bin: {scores.right_bin_share:.1%} of {scores.contact_pairs} frames in contact')
    return lines


# --- lines ------------------------------------------------------------------------------------------------------


def _title(shot: Snapshot) -> Text:
    level = 2 if is_old(shot) else int(shot.force.status) if shot.force is not None else 1
    title = Text.assemble(
        (_topic(shot), BOLD),
        f'  {shot.running_s:6.1f} s  {hz(shot.arrivals_hz)} fps  ',
    )
    title.append(state_text(shot), LEVELS[min(level, 2)])
    return title


def _latency_lines(shot: Snapshot) -> list[Text]:
    lines = [Text('latency [ms]   p50     p99', BOLD)]
    for stage in STAGES:
        found = shot.latencies[stage]
        text = f'{stage:<11} {milliseconds(found.p50):>6}  {milliseconds(found.p99):>6}'
        lines.append(Text(text, BOLD if stage == STAGES[-1] else _PLAIN))
    return lines


def _side_by_side(left: list[Text], right: list[Text]) -> Iterator[Text]:
    for one, other in zip_longest(left, right):
        text = one.copy() if one is not None else Text()
        if other is not None:
            text.pad_right(max(2, MAP_WIDTH + 2 - text.cell_len))
            text.append_text(other)
        yield text


def _force_line(shot: Snapshot) -> Text:
    overall = f'  RMSE {shot.scores.rmse_n:.3f} N' if shot.scores.pairs else ''
    return Text.assemble(('force    ', BOLD), _total_text(shot).removeprefix('force '), overall)


def _place_line(shot: Snapshot) -> Text:
    return Text.assemble(('contact  ', BOLD), _place_text(shot).removeprefix('contact '))


def _net_lines(shot: Snapshot) -> list[Text]:
    """Net force lines; none for models that estimate only normal forces."""
    text = net_text(shot.force)
    return [Text.assemble(('acting   ', BOLD), text)] if text else []


def _counts_line(shot: Snapshot) -> Text:
    text = Text.assemble(('frames   ', BOLD), f'{shot.frames}, {hz(shot.stamps_hz)} fps by stamps, {_drops_text(shot)}')
    if shot.malformed:
        text.append(f', {shot.malformed} malformed', LEVELS[1])
    return text


def _provenance_line(shot: Snapshot) -> Text:
    provenance = shot.force.provenance
    model = f'{provenance.model or "?"} ({provenance.model_id or "?"})'
    text = f'{model}  gel {provenance.gel or "?"}  rest {provenance.reference_id or "none"}'
    return Text.assemble(('model    ', BOLD), text)


def health_lines(shot: Snapshot, least: int = 0) -> list[Text]:
    """Diagnostics of nodes from that level up, the worst first, and nodes that went silent."""
    lines = []
    quiet = silent(shot.health)
    for entry in _by_level(shot.health):
        if entry.level < least and entry not in quiet:
            continue
        name = _LEVEL_NAMES[min(entry.level, 3)]
        text = Text.assemble((f'{entry.node}  ', _DIM), (name, LEVELS[min(entry.level, 3)]))
        text.append(f'  {entry.text}' if entry.text else '')
        if entry in quiet:
            text.append(f'  silent for {entry.age_s:.0f} s', LEVELS[1])
        lines.append(text)
    return lines


# --- pieces -----------------------------------------------------------------------------------------------------


def _total_text(shot: Snapshot) -> str:
    pair = shot.pair
    text = f'force {shot.force.total:6.3f} N'
    return text if pair is None else f'{text}  true {shot.truth.total:6.3f} N  error {pair.error_n:+.3f} N'


def _place_text(shot: Snapshot) -> str:
    pair = shot.pair
    others = len(shot.force.contacts) - 1
    text = f'contact {where(shot.force)}{f" and {others} more" if others > 0 else ""}'
    if pair is None:
        return text
    apart = f'  off by {pair.distance_mm:.2f} mm' if not math.isnan(pair.distance_mm) else ''
    return f'{text}  true {where(pair.truth)}{apart}'


def net_text(force: Any) -> str:
    """Net shear with its direction on the map, torsion, and the contact model that explained the motion."""
    found = net_of(force)
    if not found.is_known:
        return ''
    way = _WAYS[round(found.direction_rad / math.tau * len(_WAYS)) % len(_WAYS)] if found.shear_n > 0 else ' '
    parts = [f'shear {found.shear_n:.3f}±{found.shear_sigma_n:.3f} N {way}']
    if not math.isnan(found.torsion_n_mm):
        parts.append(f'torsion {found.torsion_n_mm:.1f}±{found.torsion_sigma_n_mm:.1f} N mm')
    return '  '.join([*parts, *([f'explained by {found.explanation}'] if found.explanation else [])])


def where(force: Any) -> str:
    if not force.in_contact or math.isnan(force.contact.x):
        return ('unknown' if force.status == force.STATUS_INVALID else 'none').ljust(18)
    return f'({force.contact.x * 1000:+6.2f}, {force.contact.y * 1000:+6.2f}) mm'


def _drops_text(shot: Snapshot) -> str:
    return f'{shot.lost} lost in transit, {shot.skipped} skipped by the sender'


def is_old(shot: Snapshot) -> bool:
    """Whether the last force is too old to be shown as current."""
    return shot.age_s > OLD_S


def state_text(shot: Snapshot) -> str:
    """The status of the force. If the force is old: the time since then, and its status."""
    if shot.force is None:
        return 'waiting'
    status = _status_text(shot.force)
    return f'no force for {shot.age_s:.1f} s, the last was {status}' if is_old(shot) else status


def _status_text(force: Any) -> str:
    name = _STATUSES[force.status] if force.status < len(_STATUSES) else f'status {force.status}'
    reasons = reason_names(force.reasons)
    return f'{name}: {", ".join(reasons)}' if reasons else name


def _by_level(health: tuple[NodeHealth, ...]) -> list[NodeHealth]:
    return sorted(health, key=lambda entry: -entry.level)


def _true_bin(shot: Snapshot) -> int | None:
    comparable = shot.pair is not None and shot.pair.right_bin is not None
    return strongest(shot.truth) if comparable else None


def _topic(shot: Snapshot) -> str:
    return f'{shot.namespace.rstrip("/")}/{FORCE_DISTRIBUTION.name}'


def milliseconds(seconds: float) -> str:
    return '-' if math.isnan(seconds) else f'{seconds * 1000:.2f}'


def hz(rate: float) -> str:
    return '-' if math.isnan(rate) else f'{rate:.1f}'
