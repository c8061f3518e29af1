"""Fits and readings are the same whatever kernels OpenBLAS takes for a processor, to a hundredth of their error.

Kernels differ in the last digits alone. What makes more of that hangs on chance: which of several solutions is found.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

NEEDED = {
    'Haswell': {'avx2', 'fma'},
    'Zen': {'avx2', 'fma'},
    'Sandybridge': {'avx'},
    'SkylakeX': {'avx512f', 'avx512cd', 'avx512bw', 'avx512dq', 'avx512vl'},
}
"""What a processor must have for the kernels of each type."""
SAME = {'Zen': 'Haswell'}
"""Who has no kernels of a type takes these: numpy and scipy as they come from pip, while OpenCV has Zen's own."""
FIRST = 'Sandybridge'
"""What every processor of the last ten years can run."""
SHARE = 0.01


@pytest.fixture(scope='module')
def made() -> dict[str, dict[str, np.ndarray]]:
    """By kernel, as far as asked for."""
    return {}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('kernels')


def errors_with(kernel: str, folder: Path, made: dict[str, dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    if kernel not in made:
        require(kernel)
        script, file = Path(__file__).with_name('fits_of_a_kernel.py'), folder / f'{kernel}.npz'
        subprocess.run([sys.executable, script, file], env=environment_of(kernel), check=True)
        with np.load(file) as found:
            made[kernel] = dict(found)
    taken = set(made[kernel]['kernels'].tolist())
    if not taken & {kernel, SAME.get(kernel)}:  # another library's OpenBLAS may be older and know it by another name
        pytest.skip(f'asked for the kernels of {kernel}, this OpenBLAS takes those of {taken or "nobody"}')
    return made[kernel]


def environment_of(kernel: str) -> dict[str, str]:
    """That of a process with these kernels, which finds what all tests share."""
    folders = [str(Path(__file__).parents[1]), *os.environ.get('PYTHONPATH', '').split(os.pathsep)]
    chosen = {'OPENBLAS_CORETYPE': kernel, 'OPENBLAS_NUM_THREADS': '1'}
    return {**os.environ, **chosen, 'PYTHONPATH': os.pathsep.join(filter(None, folders))}


def require(kernel: str) -> None:
    cpu = Path('/proc/cpuinfo')
    flags = (
        next((line for line in cpu.read_text().splitlines() if line.startswith('flags')), '') if cpu.exists() else ''
    )
    if lacking := NEEDED[kernel] - set(flags.split()):
        pytest.skip(f'this processor cannot run the kernels of {kernel}: it lacks {", ".join(sorted(lacking))}')


@pytest.mark.timeout(900)  # eight seconds of a processor for each of two types
@pytest.mark.parametrize('kernel', [each for each in NEEDED if each != FIRST])
def test_fits_read_alike_with_the_kernels_of_every_processor(
    kernel: str, folder: Path, made: dict[str, dict[str, np.ndarray]]
) -> None:
    here, first = errors_with(kernel, folder, made), errors_with(FIRST, folder, made)
    for name in here.keys() - {'kernels'}:
        error = np.sqrt(np.mean(np.square(first[name]), axis=0))
        apart = np.abs(here[name] - first[name]).max(axis=0)
        assert (apart < SHARE * error).all(), f'{name}: {apart} apart, where errors are {error}'
