"""Messages of Grbl, grblHAL and FluidNC, as values and as text."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from tactile_nodes.drivers.cnc.contract import CncState, Place
from tactile_nodes.errors import ConfigurationError

BANNER = re.compile(r'(Grbl|GrblHAL) \d+\.\d+.*\[', re.IGNORECASE)
MM_PER_INCH = 25.4
LINE_LIMIT = 79
REALTIME = frozenset('?!~')

ERRORS = {
    1: 'a word without a letter', 2: 'a bad number', 3: 'an unknown $ command', 5: 'homing is switched off',
    8: 'not idle', 9: 'locked by an alarm or a jog', 10: 'soft limits need homing', 11: 'the line is too long',
    15: 'the jog exceeds the travel', 16: 'a bad jog', 20: 'an unsupported command', 22: 'no feed',
    24: 'two commands use the axes', 33: 'a bad target', 79: 'an alarm that needs a reset first',
}  # fmt: skip
ALARMS = {
    1: 'a limit switch was hit', 2: 'a target beyond the soft limits', 3: 'a reset while it moved',
    6: 'a reset while it homed', 7: 'the door was opened while it homed',
    8: 'a limit switch stayed closed while it homed', 9: 'no limit switch was found while it homed',
    10: 'an emergency stop or a failed dual axis',
}  # fmt: skip
HOMING_REQUIRED = frozenset({11, 14})  # of grblHAL, of FluidNC
NEEDS_RESET = frozenset({1, 2, 10})
STATES = {
    'Idle': CncState.IDLE, 'Run': CncState.RUN, 'Jog': CncState.JOG, 'Hold': CncState.HOLD, 'Home': CncState.HOME,
    'Alarm': CncState.ALARM,
}  # fmt: skip


@dataclass(frozen=True)
class Report:
    """A status report; only state and position are always present."""

    state: CncState
    held: bool  # in Hold, and at rest
    word: str
    machine: Place | None
    work: Place | None
    offset: Place | None
    feed_mm_min: float = 0.0


def parse_report(line: str, factor: float = 1.0) -> Report | None:
    """A line like ``<Hold:1|MPos:-3.830,-1.000,-2.984|FS:600,0>``; None: not a report, or damaged.

    Args:
        line: without line end.
        factor: mm per unit of its positions.
    """
    if not (line.startswith('<') and line.endswith('>')):
        return None
    word, *fields = line[1:-1].split('|')
    found: dict[str, Place] = {}
    feed = 0.0
    for field in fields:
        name, _, text = field.partition(':')
        if name in {'MPos', 'WPos', 'WCO'}:
            place = _place(text, factor)
            if place is None:
                return None
            found[name] = place
        elif name in {'F', 'FS'} and re.match(r'\d+(\.\d+)?(,|$)', text):
            feed = float(text.partition(',')[0]) * factor
    if not found.keys() & {'MPos', 'WPos'}:
        return None
    state = STATES.get(word.partition(':')[0], CncState.OTHER)
    return Report(state, word == 'Hold:0', word, found.get('MPos'), found.get('WPos'), found.get('WCO'), feed)


def _place(text: str, factor: float) -> Place | None:
    try:
        x, y, z, *_ = (float(part) * factor for part in text.split(','))
    except ValueError:
        return None
    return (
        (x, y, z) if all(map(math.isfinite, (x, y, z))) else None
    )  # comparisons with NaN would pass the check of the safe height


def number_of(line: str) -> int:
    """The number after the colon of ``error:9`` or ``ALARM:2``; 0 if there is none."""
    text = line.partition(':')[2].strip()
    return int(text) if text.isdigit() else 0


def error_text(line: str) -> str:
    """An error as text. Some builds print text instead of a number; it is returned unchanged."""
    number = number_of(line)
    return f'error {number}, {ERRORS[number]}' if number in ERRORS else line


def alarm_text(number: int) -> str:
    """An alarm as text."""
    return f'alarm {number}, {ALARMS.get(number, "unknown")}'


def setting_of(line: str) -> tuple[int, str] | None:
    """Number and value in a line like ``$130=200.000``; old firmware adds a comment."""
    match = re.match(r'\$(\d+)=([^ (]*)', line)
    return (int(match.group(1)), match.group(2)) if match else None


def inches(setting: str) -> float:
    """The factor to mm by setting $13."""
    return MM_PER_INCH if setting.strip() not in {'0', ''} else 1.0


def check_line(line: str) -> None:
    """Check a line: real-time characters act at any place, so no line may contain one.

    Raises:
        ConfigurationError: the line cannot be sent.
    """
    if not line.isascii() or not line.isprintable() or set(line) & REALTIME or len(line) > LINE_LIMIT:
        raise ConfigurationError(
            f'cannot send {line!r} to Grbl: a line is at most {LINE_LIMIT} ASCII characters without ? ! ~'
        )


def is_moving(report: Report) -> bool:
    """Whether a report shows motion."""
    return report.state in {CncState.RUN, CncState.JOG, CncState.HOME} or report.word == 'Hold:1'
