"""A process to be started, all substitutions made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class ProcessPlan:
    """A process to be started.

    Attributes:
        name: its label and number, ``camera_node-1``.
        command: program and arguments; joined by spaces where `shell` is true.
        output: where its lines go: log, screen, both, own_log or full.
        respawn_max_retries: how often to start it again; below zero without end.
        required: the launch ends with it; if `respawn` too, only when it ends by itself, fails soon after its start, or
            fails in a way that a person has to see to (`errors.NOT_AGAIN`).
        holds_sigint: begin with SIGINT blocked, so that it waits until the program is ready for it and lets it in.
        sigterm_timeout: seconds from SIGINT to SIGTERM, as the text in which it was given.
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
