"""What a device says about itself, in the levels of `diagnostic_msgs/DiagnosticStatus`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """How much a person should care; the numbers are those of `DiagnosticStatus.OK`, `WARN`, `ERROR`, `STALE`."""

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
    """Whether nothing else is wrong but that it says nothing, which may be over by itself."""
