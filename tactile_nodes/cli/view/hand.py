"""Snapshots of a hand: a row for each sensor, and the total force and torque."""

from __future__ import annotations

import math
from typing import Any

from rich.text import Text

from tactile_nodes.cli.view.render import BOLD, LEVELS, health_lines, hz, is_old, milliseconds, state_text, where
from tactile_nodes.viewing.net import net_of
from tactile_nodes.viewing.state import Snapshot

_WARNING = 1
_HEAD = f'{"sensor":<12} {"fps":>5}  {"force [N]":>9}  {"shear [N]":>9}  {"contact":<18}  {"margin":>6}  state'


def picture(shot: Snapshot) -> Text:
    lines = [Text.assemble(('hand', BOLD), f'  {shot.running_s:6.1f} s'), Text(), Text(_HEAD, BOLD)]
    for sensor in shot.sensors:
        row = Text(f'{_name(sensor, shot):<12} {hz(sensor.arrivals_hz):>5}  {_numbers(sensor, shot.wrench)}')
        row.append(state_text(sensor), LEVELS[_level(sensor)])
        lines.append(row)
    lines += [Text(), Text.assemble(('sum      ', BOLD), _sum_text(shot.wrench))]
    lines += health_lines(shot, _WARNING)
    lines += [Text(line, LEVELS[_WARNING]) for line in shot.logs]
    text = Text('\n').join(lines)
    text.no_wrap, text.overflow = True, 'ellipsis'
    return text


def line(shot: Snapshot) -> str:
    """The view as one line, for a log or a pipe."""
    sensors = (
        f'{_name(each, shot)} {"" if each.force is None else f"{each.force.total:.3f} N "}{state_text(each)}'
        for each in shot.sensors
    )
    return '  '.join([f'{shot.running_s:7.1f} s', *sensors, f'sum {_sum_text(shot.wrench)}'])


def summary(shot: Snapshot) -> str:
    """The text that is printed at the end; `shot` covers the whole run."""
    rows = [f'{"sensor":<12} {"frames":>7}  {"fps":>5}  {"p50":>6}  {"p99":>6} ms  lost  skipped  invalid']
    for each in shot.sensors:
        total = each.latencies['end to end']
        rows.append(
            f'{_name(each, shot):<12} {each.frames:>7}  {hz(each.arrivals_hz):>5}  {milliseconds(total.p50):>6}  '
            f'{milliseconds(total.p99):>6}     {each.lost:>4}  {each.skipped:>7}  {each.invalid:>7}'
        )
    return '\n'.join(rows)


def _name(sensor: Snapshot, shot: Snapshot) -> str:
    return sensor.namespace.removeprefix(shot.namespace.rstrip('/')).strip('/')


def _level(sensor: Snapshot) -> int:
    if sensor.force is None:
        return _WARNING
    return 2 if is_old(sensor) else min(int(sensor.force.status), 2)


def _numbers(sensor: Snapshot, wrench: Any) -> str:
    if sensor.force is None:
        return ' ' * 52
    net = net_of(sensor.force)
    shear = f'{net.shear_n:9.3f}' if net.is_known else f'{"-":>9}'
    return f'{sensor.force.total:9.3f}  {shear}  {where(sensor.force)}  {_margin(sensor.namespace, wrench):>6}  '


def _margin(namespace: str, wrench: Any) -> str:
    """The smallest margin of the sensor's contacts."""
    name = namespace.rpartition('/')[2]
    margins = [each.margin for each in (wrench.margins if wrench else ()) if each.sensor == name]
    usable = [each for each in margins if not math.isnan(each)]
    return f'{min(usable):.2f}' if usable else '-'


def _sum_text(wrench: Any) -> str:
    """Force and torque on all gels, in the frame of the hand."""
    if wrench is None:
        return 'no data: nothing comes on hand_wrench'
    missing = f'  without {", ".join(wrench.missing)}' if wrench.missing else ''
    if not wrench.sensors:
        return f'not known{missing}'
    force, torque = wrench.wrench.force, wrench.wrench.torque
    return (
        f'force {force.x:+.3f} {force.y:+.3f} {force.z:+.3f} N{missing}  '
        f'torque {torque.x:+.4f} {torque.y:+.4f} {torque.z:+.4f} N m  in {wrench.header.frame_id}'
    )
