"""A controller to begin with: a gripper that opens when the force is too large, or not to be trusted.

    tactile launch live &
    python examples/grip.py

It decides fifty times a second by the newest force, because silence calls nobody. A loop that is stable with a late
force too stands in tactile_nodes/collection/press/guarded.py.
"""

from __future__ import annotations

import sys
from typing import Any

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Received
from tactile_nodes.messages import stamp_ns

LIMIT_N = 0.5
OLD_MS = 100.0
PERIOD_S = 0.02


class GripNode(Node):
    """Says when it opens, and why."""

    NAME = 'grip'

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._force: Any = None
        self.reason = ''
        self.create_subscription(topics.FORCE_DISTRIBUTION, self._on_force)
        self.create_timer(PERIOD_S, self._control)

    def _on_force(self, received: Received) -> None:
        self._force = received.message

    def _control(self) -> None:
        reason = self._reason_to_open()
        if reason != self.reason:
            self.log.info(f'opens: {reason}' if reason else 'closes')
        self.reason = reason
        self._move(opening=bool(reason))

    def _reason_to_open(self) -> str:
        if self._force is None:
            return 'there is no force yet'
        age_ms = (self.clock.now_ns() - stamp_ns(self._force.header.stamp)) / 1e6
        if age_ms > OLD_MS:
            return 'the force is old'
        if age_ms < -OLD_MS:
            return 'the force is stamped in the future: the clock of its machine is ahead'
        if self._force.status == self._force.STATUS_INVALID:
            return 'the force is invalid'
        return '' if self._force.total <= LIMIT_N else f'more than {LIMIT_N} N'  # also opens for NaN

    def _move(self, opening: bool) -> None:
        """Your gripper here."""


if __name__ == '__main__':
    sys.exit(run_node(GripNode))
