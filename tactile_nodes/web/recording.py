"""Whether the sensor is being recorded, from the diagnostics of the recorder."""

from __future__ import annotations

from typing import Any

from tactile_nodes.bus.protocol import Received
from tactile_nodes.viewing.measures import NS_PER_S
from tactile_nodes.viewing.state import SILENT_AFTER_S

RECORDER = 'recorder'
_PART = 'bag'
_OK = 0


class Recording:
    """Reads the diagnostics of the recorder in one namespace."""

    def __init__(self, namespace: str = '/') -> None:
        self._name = f'{namespace.strip("/")}/{RECORDER}: {_PART}'.lstrip('/')
        self._status: Any = None
        self._received_ns = 0

    def add_diagnostics(self, received: Received) -> None:
        for status in received.message.status:
            if status.name.lstrip('/') == self._name:
                self._status = status
                self._received_ns = received.received_ns

    def summary(self, now_ns: int) -> dict[str, Any] | None:
        """On or off, how much, and the recorder's message; None if there is no recorder.

        After a recording, `text` says where the bag is, what was lost on which topics, and what this means for its use.
        A recorder that was recording and has been silent for a while counts as off.
        """
        if self._status is None:
            return None
        values = {each.key: each.value for each in self._status.values}
        silent_s, on = (now_ns - self._received_ns) / NS_PER_S, 'seconds' in values
        lost_touch = on and silent_s > SILENT_AFTER_S
        return {
            'on': on and not lost_touch,
            'seconds': float(values.get('seconds', 0.0)),
            'lost': int(values.get('lost', 0)),
            'bag': values.get('bag', ''),
            'well': _is_ok(self._status.level) and not lost_touch,
            'text': _of_silent(silent_s, values.get('bag', '')) if lost_touch else self._status.message,
        }


def _of_silent(seconds: float, bag: str) -> str:
    return f'no message from the recorder for {seconds:.0f} s: it has ended or hangs; its bag is {bag}'


def _is_ok(level: Any) -> bool:
    return (level[0] if isinstance(level, bytes) else int(level)) == _OK
