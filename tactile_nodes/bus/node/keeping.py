"""What a node finds again when it is killed and the same launch starts it again.

`tactile launch` names a folder of its own to the processes that it starts. There a node keeps the few things that were
decided while it ran: parameters that were set, the rest image in use, that a recording was under way. A node that is
started otherwise, or by another launch, finds nothing and begins anew.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactile_nodes.errors import BusError

VARIABLE = 'TACTILE_KEEP'
_CHANGES = 'parameters'


class Kept:
    """The things that one node keeps, by name, as bytes; a file is always whole, whenever its writer is killed."""

    def __init__(self, node: str) -> None:
        folder = os.environ.get(VARIABLE, '')
        self._stem = Path(folder) / node.strip('/').replace('/', '.') if folder else None

    def put(self, name: str, data: bytes) -> None:
        """Keep this, in the place of what was kept before.

        Raises:
            BusError: it cannot be written; then nothing is kept, because what was kept before is outdated.
        """
        if self._stem is None or self.get(name) == data:
            return
        try:
            self._write(name, data)
        except BusError:
            self.drop(name)
            raise

    def get(self, name: str) -> bytes | None:
        try:
            return None if self._stem is None else self._file(name).read_bytes()
        except OSError:
            return None

    def drop(self, name: str) -> None:
        """Keep it no longer, if the disk can be written: what a node ends just now must not fail because of this."""
        if self._stem is not None:
            with contextlib.suppress(OSError):
                self._file(name).unlink(missing_ok=True)

    @property
    def changes(self) -> dict[str, Any]:
        """The parameters that were set while the node ran."""
        return {} if (text := self.get(_CHANGES)) is None else _values(text)

    def add_changes(self, before: Mapping[str, object], after: Mapping[str, object]) -> None:
        """Keep the parameters that differ. Raises BusError; then those that were kept before are still kept."""
        new = {name: value for name, value in after.items() if value != before[name]}
        if self._stem is not None and new:
            self._write(_CHANGES, json.dumps({**self.changes, **new}).encode())

    def _write(self, name: str, data: bytes) -> None:
        file = self._file(name)
        draft = file.with_name(f'.{file.name}')
        try:
            file.parent.mkdir(mode=0o700, exist_ok=True)
            draft.write_bytes(data)
            draft.rename(file)
        except OSError as error:
            raise BusError(
                f'cannot store {name} in {file.parent} ({error.strerror}); it will not be available after a restart'
            ) from error

    def _file(self, name: str) -> Path:
        assert self._stem is not None
        return self._stem.with_name(f'{self._stem.name}.{name}')


def _values(text: bytes) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:  # damaged by somebody else: as good as none
        return {}
    return found if isinstance(found, dict) else {}
