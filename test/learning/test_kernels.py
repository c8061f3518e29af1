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
"""Who has no kernels of a type takes these, as numpy and scipy from pip; those of a distribution may have their own."""
FIRST = 'Sandybridge'
"""What every processor of the last ten years can run."""
SHARE = 0.01


@pytest.fixture(scope='module')
def made() -> dict[str, dict[str, np.ndarray]]:
    """By the kernels that were asked for, and those that were taken."""
    return {}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('kernels')


def errors_with(kernel: str, folder: Path, made: dict[str, dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    require(kernel)
    if kernel not in made:
        taken = run(kernel, 'kernels_in_use.py') if kernel in SAME else ''
        if taken not in made:
            file = folder / f'{kernel}.npz'
            taken = run(kernel, 'fits_of_a_kernel.py', str(file))
            with np.load(file) as found:
                made[taken] = dict(found)
        if not {kernel, SAME.get(kernel)} & set(taken.split()):  # an older OpenBLAS may know it by another name
            pytest.skip(f'asked for the kernels of {kernel}, this OpenBLAS takes those of {taken or "nobody"}')
        made[kernel] = made[taken]
    return made[kernel]


def run(kernel: str, script: str, *words: str) -> str:
    """What a script says in a process with these kernels."""
    command = [sys.executable, str(Path(__file__).with_name(script)), *words]
    ended = subprocess.run(command, env=environment_of(kernel), check=True, stdout=subprocess.PIPE, text=True)
    return ended.stdout.strip()


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
    for name in here:
        error = np.sqrt(np.mean(np.square(first[name]), axis=0))
        apart = np.abs(here[name] - first[name]).max(axis=0)
        assert (apart < SHARE * error).all(), f'{name}: {apart} apart, where errors are {error}'
