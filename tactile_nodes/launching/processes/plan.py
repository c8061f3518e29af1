"""A process to be started, with all substitutions made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class ProcessPlan:
    """A process to be started.

    Attributes:
        name: its label and number, e.g. ``camera_node-1``.
        command: program and arguments; joined by spaces where `shell` is true.
        output: where its lines go: log, screen, both, own_log or full.
        respawn_max_retries: how often to restart it; below zero: no limit.
        required: the launch ends with it. If `respawn` is set too: only if it exits by itself, fails soon after its
            start, or fails with an error that a person must fix (`errors.NOT_AGAIN`).
        holds_sigint: start with SIGINT blocked, until the program is ready for it and unblocks it.
        sigterm_timeout: seconds from SIGINT to SIGTERM, as the string in which it was given.
        sigkill_timeout: seconds from SIGTERM to SIGKILL, likewise.
    """

    name: str
    command: tuple[str, ...]
    cwd: str | None
    environment: Mapping[str, str]
    shell: bool
    emulate_tty: bool
    output: str
    respawn: bool
    respawn_delay_s: float
    respawn_max_retries: int
    required: bool
    holds_sigint: bool
    sigterm_timeout: str
    sigkill_timeout: str

    @property
    def command_line(self) -> str:
        return ' '.join(word for word in self.command if word.strip())
