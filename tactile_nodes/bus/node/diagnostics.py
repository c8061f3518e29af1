"""How a node is, reported once a second on /diagnostics."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from tactile_nodes.messages import time_from_ns, types


class Level(IntEnum):
    """diagnostic_msgs/DiagnosticStatus levels."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


ENDED = 'ended'
"""Message of the last status of a node that ends as it was asked to: views do not take it for silent then."""
NO_HARDWARE = 'none'  # as diagnostic_updater of ROS 2 has it for software

_LOGGED_EVERY_S = 60.0
_MOST_LOGGED = 10
_OVER_AFTER_S = 10.0


@dataclass
class _Part:
    level: Level = Level.OK
    text: str = ''
    values: dict[str, object] = field(default_factory=dict)


class Diagnostics:
    """The state of a node's parts ('camera', 'reference'); kept by the node's callbacks, published by its timer.

    `hardware` says to which device a part speaks: the name by which the operator chose it.
    """

    def __init__(self, node: str) -> None:
        self.hardware: dict[str, str] = {}
        self._node = node.lstrip('/')
        self._parts: dict[str, _Part] = {}
        self._lock = threading.Lock()

    def report(self, part: str, level: Level, text: str, **values: object) -> bool:
        """Say how `part` is; true when that is better or worse than before, or the first time."""
        with self._lock:
            earlier = self._parts.setdefault(part, _Part(Level.STALE))
            changed = earlier.level != level
            self._parts[part] = _Part(level, text, dict(values))
            return changed

    def message(self, now_ns: int) -> types.DiagnosticArray:
        """All parts as one message; a node that has said nothing yet is running."""
        with self._lock:
            parts = self._parts or {'node': _Part(Level.OK, 'running')}
            return self._message(now_ns, parts)

    def farewell(self, now_ns: int) -> types.DiagnosticArray:
        """The last message of a node that ends as it was asked to."""
        return self._message(now_ns, {'node': _Part(Level.STALE, ENDED)})

    def _message(self, now_ns: int, parts: Mapping[str, _Part]) -> types.DiagnosticArray:
        statuses = [self._status(name, part) for name, part in parts.items()]
        return types.DiagnosticArray(header=types.Header(stamp=time_from_ns(now_ns)), status=statuses)

    def _status(self, name: str, part: _Part) -> types.DiagnosticStatus:
        hardware_id = self.hardware.get(name, NO_HARDWARE)
        return types.DiagnosticStatus(
            level=int(part.level),
            name=f'{self._node}: {name}',
            message=part.text,
            hardware_id=hardware_id,
            values=[types.KeyValue(key=key, value=_text(value)) for key, value in part.values.items()],
        )


class RecentErrors:
    """Which errors of a node's callbacks to log, and when they are over.

    A text is logged once a minute, and no more than ten a minute: a text may hold a number that differs in each frame.
    """

    def __init__(self) -> None:
        self._logged_s: dict[str, float] = {}
        self._last_s: float | None = None

    def add(self, text: str, now_s: float) -> bool:
        """Note an error; returns whether to log it."""
        self._last_s = now_s
        self._logged_s = {each: at_s for each, at_s in self._logged_s.items() if now_s - at_s < _LOGGED_EVERY_S}
        if text in self._logged_s or len(self._logged_s) >= _MOST_LOGGED:
            return False
        self._logged_s[text] = now_s
        return True

    def are_over(self, now_s: float) -> bool:
        """Whether there were errors, and none for some seconds; true once."""
        if self._last_s is None or now_s - self._last_s < _OVER_AFTER_S:
            return False
        self._last_s = None
        return True


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
