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
    'SkylakeX': {'avx512f', 'avx512cd', 'avx512bw', 'avx512dq', 'avx512vl'},
}
"""What a processor must have for the kernels of each type."""
FIRST = 'Sandybridge'
"""What every processor of the last ten years can run."""
SHARE = 0.01


def errors_with(kernel: str, folder: Path) -> dict[str, np.ndarray]:
    taken = run(kernel, 'kernels_in_use.py')
    if kernel not in taken.split():  # an older OpenBLAS may know it by another name
        pytest.skip(f'asked for the kernels of {kernel}, this OpenBLAS takes those of {taken or "nobody"}')
    file = folder / f'{kernel}.npz'
    run(kernel, 'fits_of_a_kernel.py', str(file))
    with np.load(file) as found:
        return dict(found)


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


def widest() -> str:
    """The last of the kernels that this processor can run."""
    cpu = Path('/proc/cpuinfo')
    lines = cpu.read_text().splitlines() if cpu.exists() else []
    flags = next((line.split() for line in lines if line.startswith('flags')), [])
    return [FIRST, *(kernel for kernel, needed in NEEDED.items() if needed <= set(flags))][-1]


@pytest.mark.timeout(900)  # eight seconds of a processor for each of two types
def test_fits_read_alike_with_the_oldest_and_the_newest_kernels_that_this_processor_runs(tmp_path: Path) -> None:
    if (kernel := widest()) == FIRST:
        pytest.skip(f'this processor runs no kernels but those of {FIRST}')
    here, first = errors_with(kernel, tmp_path), errors_with(FIRST, tmp_path)
    for name in here:
        error = np.sqrt(np.mean(np.square(first[name]), axis=0))
        apart = np.abs(here[name] - first[name]).max(axis=0)
        assert (apart < SHARE * error).all(), f'{name}: {apart} apart, where errors are {error}'
