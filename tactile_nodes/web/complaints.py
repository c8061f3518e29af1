"""Log lines of a server: refused requests are counted and reported once a minute, bugs are reported once."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from typing import Any

from aiohttp.http_exceptions import HttpProcessingError

SAY_EVERY_S = 60.0
LONGEST = 160  # characters of a reason


class Complaints(logging.Handler):
    """Takes reports of aiohttp and asyncio away from the terminal; `say` gets the lines that a person should read."""

    def __init__(self, say: Callable[[str], None], now_s: Callable[[], float]) -> None:
        super().__init__()
        self.refused = 0
        self.logger = logging.Logger('tactile_nodes.web')
        self.logger.addHandler(self)
        self._say = say
        self._now_s = now_s
        self._reported = 0
        self._next_s = -float('inf')
        self._bugs: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, HttpProcessingError):
            self.count(f'malformed, {error.message.partition(":")[0]!a}')
        elif record.levelno >= logging.WARNING:
            self._report(error, record.getMessage())

    def take(self, _: object, context: dict[str, Any]) -> None:
        """Report of asyncio's loop about an exception that was not caught (``loop.set_exception_handler``)."""
        self._report(context.get('exception'), context['message'])

    def count(self, reason: str) -> None:
        """Count a refused request that no correct client sends."""
        self.refused += 1
        now_s = self._now_s()
        if now_s < self._next_s:
            return
        more = self.refused - self._reported
        self._reported, self._next_s = self.refused, now_s + SAY_EVERY_S
        self._say(f'requests refused: {more}, {self.refused} in total; last: {" ".join(reason.split())[:LONGEST]}')

    def _report(self, error: BaseException | None, text: str) -> None:
        if error is not None:
            text += '\n' + ''.join(traceback.format_exception(error))
        # Reported once per place in the code: the text of a request may be new each time.
        where = text if error is None else ''.join(traceback.format_tb(error.__traceback__))
        if where not in self._bugs:
            self._bugs.add(where)
            self._say(f'bug in the server, which continues: {text}')
