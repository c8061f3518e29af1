"""Stores finished parts of a long run until all of it is done, so that a killed run can be resumed."""

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
    """Parts of one configuration at one state of the source; without a folder, nothing is stored."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self.found = 0

    @classmethod
    def of(cls, benchmark: str, configuration: Mapping[str, Any]) -> Parts:
        """The parts of a benchmark with these arguments and the present source."""
        source = state(share_directory())
        if source is None:
            return cls(None)
        settings = json.dumps({'source': source, **configuration}, sort_keys=True, default=str)
        key = hashlib.sha256(settings.encode()).hexdigest()[:16]
        return cls(cache_directory() / 'benchmarks' / f'{benchmark}_{key}')

    def get(self, name: str, make: Callable[[], Any]) -> Any:
        """A part as plain JSON data: the stored one, or a new one."""
        kept = self.kept(name)
        return self.keep(name, make()) if kept is None else kept

    def kept(self, name: str) -> Any:
        """A stored part; None if it must be measured."""
        file = self._file(name)
        if file is None or not file.is_file():
            return None
        self.found += 1
        return json.loads(file.read_text(encoding='utf-8'))

    def keep(self, name: str, measured: Any) -> Any:
        """Store a part; returns it as plain JSON data."""
        text, file = json.dumps(measured), self._file(name)
        if file is not None:
            write_whole(file, text.encode())
        return json.loads(text)

    def _file(self, name: str) -> Path | None:
        return None if self._folder is None else self._folder / f'{_file_name(name)}.json'

    def forget(self) -> None:
        """Delete the stored parts, after the whole run is done."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)


def _file_name(part: str) -> str:
    """A readable and unique file name for a part."""
    return f'{re.sub(r"[^a-zA-Z0-9]+", "_", part)}_{hashlib.sha256(part.encode()).hexdigest()[:6]}'
