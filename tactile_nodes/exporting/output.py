"""The output folder of an export: it appears only when it is complete."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactile_nodes.errors import DatasetError

FACTS = 'tactile.json'


@contextlib.contextmanager
def made_whole(output: Path, *, replace: bool = False) -> Iterator[Path]:
    """A folder to write into. It becomes `output` when the block succeeds, and is removed when the block fails.

    Raises:
        DatasetError: `output` exists and may not be replaced, or is no export, or cannot be written.
    """
    _require_free(output, replace)
    draft = output.absolute().with_name(f'.{output.absolute().name}.part')
    try:
        shutil.rmtree(draft, ignore_errors=True)  # left by an export that was killed
        draft.mkdir(parents=True)
        yield draft
        replaced = draft.with_suffix('.old')
        shutil.rmtree(replaced, ignore_errors=True)
        if output.exists():
            output.rename(replaced)
        draft.rename(output)
        shutil.rmtree(replaced, ignore_errors=True)  # last: deleting a large export takes long, and may be interrupted
    except OSError as error:
        shutil.rmtree(draft, ignore_errors=True)
        raise DatasetError(f'cannot write {output}: {error.strerror or error}; nothing was kept') from error
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


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
