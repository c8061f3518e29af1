"""What a node says: on its standard error stream, in ROS 2's form, and on /rosout."""

from __future__ import annotations

import contextlib
import sys

from tactile_nodes.bus.node.arguments import LEVELS
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import BusError
from tactile_nodes.messages import time_from_ns, types


class Log:
    """``[INFO] [sec.nsec] [node]: text``. With `once`, a text of that key is said once only."""

    def __init__(self, node: str, level: int, clock: Clock) -> None:
        self.publisher: Publisher | None = None
        self._node = node.strip('/').replace('/', '.')
        self._level = level
        self._clock = clock
        self._logged: set[str] = set()

    def debug(self, text: str) -> None:
        self._say('debug', text)

    def info(self, text: str) -> None:
        self._say('info', text)

    def warn(self, text: str, once: str | None = None) -> None:
        self._say('warn', text, once)

    def error(self, text: str) -> None:
        self._say('error', text)

    def fatal(self, text: str) -> None:
        self._say('fatal', text)

    def _say(self, level: str, text: str, once: str | None = None) -> None:
        if LEVELS[level] < self._level or (once is not None and once in self._logged):
            return
        if once is not None:
            self._logged.add(once)
        now_ns = self._clock.now_ns()
        stamp = f'{now_ns // NS_PER_S}.{now_ns % NS_PER_S:09d}'
        with contextlib.suppress(OSError):  # a full disk, a closed pipe: no reason to end a node
            sys.stderr.write(f'[{level.upper()}] [{stamp}] [{self._node}]: {text}\n')
            sys.stderr.flush()
        publisher = self.publisher
        if publisher is not None:
            stamp_message = time_from_ns(now_ns)
            with contextlib.suppress(BusError):  # it has been closed since: what is left to say is on the screen
                publisher.publish(types.Log(stamp=stamp_message, level=LEVELS[level], name=self._node, msg=text))
