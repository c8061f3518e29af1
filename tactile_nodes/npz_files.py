"""Arrays in .npz files of a cache. A damaged file, as after a power cut, counts as missing."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tactile_nodes.files import open_plain
from tactile_nodes.paths import write_whole


def read_npz(file: Path, largest: int | None = None) -> dict[str, np.ndarray] | None:
    """All arrays of a file; None if it is missing or damaged.

    Raises:
        OSError: it cannot be read, is not a regular file, or has more than `largest` bytes.
    """
    if not file.is_file():
        return None
    try:
        # numpy does not close a file that it opened itself and cannot read
        with open_plain(file, largest) as opened, np.load(opened, allow_pickle=False) as arrays:
            return dict(arrays)
    except (EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error):
        return None


def write_npz(file: Path, arrays: Mapping[str, np.ndarray], *, compressed: bool = False) -> None:
    """Write all of a file or nothing; several processes may write it at once.

    Raises:
        ConfigurationError, OSError: as `write_whole`.
    """
    content = io.BytesIO()
    save = np.savez_compressed if compressed else np.savez
    save(content, allow_pickle=False, **arrays)
    write_whole(file, content.getvalue())
