"""Finished parts of a long run, kept until all of it is done: a run that is killed goes on where it was."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.harness.history import state
from tactile_nodes.paths import cache_directory, share_directory, write_whole


class Parts:
    """Parts of one configuration at one state of the source; None for a folder keeps nothing."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self.found = 0

    @classmethod
    def of(cls, benchmark: str, configuration: Mapping[str, Any]) -> Parts:
        """Those of a benchmark with these arguments and the source as it is now."""
        source = state(share_directory())
        if source is None:
            return cls(None)
        told = json.dumps({'source': source, **configuration}, sort_keys=True, default=str)
        key = hashlib.sha256(told.encode()).hexdigest()[:16]
        return cls(cache_directory() / 'benchmarks' / f'{benchmark}_{key}')

    def get(self, name: str, make: Callable[[], Any]) -> Any:
        """A part as JSON holds it: the one that was kept, or a new one."""
        kept = self.kept(name)
        return self.keep(name, make()) if kept is None else kept

    def kept(self, name: str) -> Any:
        """A part that was kept; None: it is to be measured."""
        file = self._file(name)
        if file is None or not file.is_file():
            return None
        self.found += 1
        return json.loads(file.read_text(encoding='utf-8'))

    def keep(self, name: str, measured: Any) -> Any:
        """Keep a part; it is returned as JSON holds it."""
        text, file = json.dumps(measured), self._file(name)
        if file is not None:
            write_whole(file, text.encode())
        return json.loads(text)

    def _file(self, name: str) -> Path | None:
        return None if self._folder is None else self._folder / f'{_file_name(name)}.json'

    def forget(self) -> None:
        """All is done."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)


def _file_name(part: str) -> str:
    """Readable, and another one for every name."""
    return f'{re.sub(r"[^a-zA-Z0-9]+", "_", part)}_{hashlib.sha256(part.encode()).hexdigest()[:6]}'
