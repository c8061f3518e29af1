"""Records the true tip position of an emulated rig, which only the world knows.

JSON lines: ``{"at": ns, "tip": [x, y, z], "force": N}`` in machine coordinates (mm), and ``{"at": ns, "faults": {name:
value}}`` when faults are switched.
"""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

from tactile_nodes.clock import Clock
from tactile_nodes.emulators.world import World

PERIOD_S = 0.01


class RigTrace:
    """Writes while it is open; without a file it writes nothing."""

    def __init__(self, world: World, clock: Clock, file: str) -> None:
        self._world = world
        self._clock = clock
        self._file = Path(file).open('a', encoding='ascii') if file else None  # noqa: SIM115  (closed at the exit)
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_down, name='rig trace', daemon=True)

    def __enter__(self) -> RigTrace:
        if self._file is not None:
            self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._ending.set()
        if self._file is not None:
            self._thread.join()
            self._file.close()

    def switched(self, had: Any, wanted: Any) -> None:
        """Record which faults were switched."""
        before, after = vars(had), vars(wanted)
        if changed := {name: value for name, value in after.items() if value != before[name]}:
            self._say({'at': self._clock.now_ns(), 'faults': changed})

    def _write_down(self) -> None:
        while not self._ending.wait(PERIOD_S):
            now_ns = self._clock.now_ns()
            tip = [round(value, 4) for value in self._world.tip_at(now_ns)]
            self._say({'at': now_ns, 'tip': tip, 'force': round(self._world.force_at(now_ns), 4)})

    def _say(self, values: dict[str, Any]) -> None:
        if self._file is not None:
            with self._lock:
                self._file.write(json.dumps(values) + '\n')
                self._file.flush()
