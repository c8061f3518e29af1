"""The output folder of an export: it appears only when it is complete."""

from __future__ import annotations

import contextlib
import fcntl
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from tactile_nodes.errors import DatasetError

FACTS = 'tactile.json'


@contextlib.contextmanager
def made_whole(output: Path, *, replace: bool = False) -> Iterator[Path]:
    """A folder to write into. It becomes `output` when the block succeeds, and is removed otherwise.

    Raises:
        DatasetError: `output` exists and may not be replaced, or is no export, or cannot be written, or another process
            is writing it.
    """
    place = output.absolute()
    draft, before, lock = (place.with_name(f'.{place.name}.{end}') for end in ('part', 'old', 'lock'))
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        with lock.open('w') as opened:
            _require_alone(opened, output)
            try:
                _tidy(output, draft, before)  # what a killed export left
                _require_free(output, replace)
                draft.mkdir()
                yield draft
                if output.exists():
                    output.rename(before)
                draft.rename(output)
                shutil.rmtree(before, ignore_errors=True)  # takes long: Ctrl-C here is followed by `_tidy`
            finally:
                _tidy(output, draft, before)
                lock.unlink(missing_ok=True)
    except OSError as error:
        raise DatasetError(f'cannot write {output}: {error.strerror or error}; nothing was kept') from error


def _require_alone(opened: IO[str], output: Path) -> None:
    """Lock a file. The kernel releases the lock when the process ends, in any way."""
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise DatasetError(
            f'another command is writing {output} right now; wait for it, or choose another name'
        ) from error


def _tidy(output: Path, draft: Path, before: Path) -> None:
    """Delete what is not needed; the export before takes its place again if the new one did not."""
    if before.exists() and not output.exists():
        before.rename(output)
    for each in (draft, before):
        shutil.rmtree(each, ignore_errors=True)


def write_json(file: Path, content: dict[str, Any]) -> None:
    """Write strict JSON; creates its folder."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + '\n', encoding='utf-8')


def _require_free(output: Path, replace: bool) -> None:
    if not output.exists():
        return
    if not replace:
        raise DatasetError(f'{output} already exists; choose another name, or replace it with --force')
    if not (output / FACTS).is_file() and not (output.is_dir() and not any(output.iterdir())):
        raise DatasetError(
            f'{output} is not an export of this program (it has no {FACTS}) and is not replaced; move it away'
        )
