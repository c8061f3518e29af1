"""Waits for a person who must check the rig before anything moves again."""

from __future__ import annotations

from collections.abc import Callable

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.hands import Hands, InterruptedRunError
from tactile_nodes.collection.machine_record import ACKNOWLEDGED, MachineRecord

LOOK_S = 0.05
ASK, GO_ON = 'ask', 'go_on'
AFTER_KILL = 'after a run that was cut off: ask a person before anything moves, or go_on without asking'


def require_looked(why: str, person: Person, record: MachineRecord, hands: Hands) -> None:
    """Wait until a person has checked the rig, and write that down.

    Raises:
        InterruptedRunError: the run was asked to end before that.
    """
    if not person.ask(why, lambda: hands.asked_to_stop):
        raise InterruptedRunError
    record.note(ACKNOWLEDGED, hands.clock.now_ns())


class Person:
    """Holds a question to a person. The thread of the run asks it; any other thread may answer it.

    Args:
        how: what to type for an answer.
        tell: prints a line where a person sees it.
        clock: the host's.
    """

    def __init__(self, how: str, tell: Callable[[str], None], clock: Clock) -> None:
        self._how = how
        self._tell = tell
        self._clock = clock
        self._why = ''

    @property
    def question(self) -> str:
        """The open question; empty: none."""
        return f'{self._why}; check machine, tip and gel, then type: {self._how}' if self._why else ''

    def ask(self, why: str, is_over: Callable[[], bool]) -> bool:
        """Wait for an answer; false: `is_over` became true before an answer came."""
        self._why = why
        self._tell(self.question)
        try:
            while self._why and not is_over():
                self._clock.sleep_until(self._clock.now_ns() + round(LOOK_S * NS_PER_S))
            return not self._why
        finally:
            self._why = ''

    def acknowledge(self) -> str:
        """Answer the question, so that the run continues; returns a reply for the person."""
        was_open, self._why = bool(self._why), ''
        return 'continuing' if was_open else 'there is no open question'
