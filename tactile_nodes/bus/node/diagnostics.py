"""How a node is, told once a second on /diagnostics."""

from __future__ import annotations

import threading
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


NO_HARDWARE = 'none'  # as diagnostic_updater of ROS 2 has it for software


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
            known = self._parts.setdefault(part, _Part(Level.STALE))
            changed = known.level != level
            self._parts[part] = _Part(level, text, dict(values))
            return changed

    def message(self, now_ns: int) -> types.DiagnosticArray:
        """All parts as one message; a node that has said nothing yet is running."""
        with self._lock:
            parts = self._parts or {'node': _Part(Level.OK, 'running')}
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


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
