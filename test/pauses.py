"""How long this process got no processor: what is tested in real time fails then through no fault of its own."""

from __future__ import annotations

import threading

from tactile_nodes.clock import monotonic_s

TICK_S = 0.05
LONG_S = 0.4


class Pauses(threading.Thread):
    """Wakes up twenty times a second and notes by how much it is late."""

    def __init__(self) -> None:
        super().__init__(name='pauses', daemon=True)
        self.longest_s = 0.0
        self._over = threading.Event()

    def run(self) -> None:
        last_s = monotonic_s()
        while not self._over.wait(TICK_S):
            now_s = monotonic_s()
            self.longest_s = max(self.longest_s, now_s - last_s - TICK_S)
            last_s = now_s

    def were_long(self) -> bool:
        """Whether one since `longest_s` was last set to zero may have failed a test."""
        return self.longest_s > LONG_S

    def close(self) -> None:
        """End."""
        self._over.set()
        self.join()
