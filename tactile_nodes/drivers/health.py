"""The state of a device, in the levels of `diagnostic_msgs/DiagnosticStatus`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """Severity; the numbers are those of `DiagnosticStatus.OK`, `WARN`, `ERROR`, `STALE`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Health:
    """One line for ``/diagnostics``."""

    level: Level
    message: str
    silent: bool = False
    """Whether silence is the only problem; it may pass."""
