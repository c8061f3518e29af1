"""Which kernels numpy and scipy take, in a process of its own: `OPENBLAS_CORETYPE` is read when it starts.

Each brings an OpenBLAS. So does OpenCV, but no fit or reading uses that one.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import scipy.linalg

NAMES = [f'{of}openblas_get_corename{bits}' for of in ('scipy_', '') for bits in ('64_', '')]


def kernels() -> list[str]:
    """What each OpenBLAS of numpy and scipy in this process has chosen."""
    scipy.linalg.eigvalsh(np.eye(2))
    maps = Path('/proc/self/maps').read_text().splitlines()
    loaded = {line.split()[-1] for line in maps if 'openblas' in line.split()[-1].lower()}
    files = sorted(file for file in loaded if 'opencv' not in file)
    return [core_of(ctypes.CDLL(file)) for file in files]


def core_of(library: ctypes.CDLL) -> str:
    functions = [getattr(library, name) for name in NAMES if hasattr(library, name)]
    if not functions:
        return 'unknown'
    functions[0].restype = ctypes.c_char_p
    return str(functions[0]().decode())


if __name__ == '__main__':
    print(*kernels())
