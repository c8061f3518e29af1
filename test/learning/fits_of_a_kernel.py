"""Small fits of every kind and what they read, in a process of its own: `OPENBLAS_CORETYPE` is read when it starts.

Run as `python fits_of_a_kernel.py FILE.npz`. The file holds the errors of readings; the kernels are printed.
"""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
from kernels_in_use import kernels
from layered_gel import BALL, SENSOR, pressed, pressed_terms, quiet_scaling, uneven
from responding_gel import AXISYMMETRIC, CONFIG, presses

from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.fit import fit_field
from tactile_nodes.learning.measured.fit import fit_response
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.fit import live_errors, transfer
from tactile_nodes.sensing.geometry import BinGrid

SOFTER, ASIDE_MM = 1.2, 0.7
FEW = 45
"""Presses that the force field is fitted to; it reads fifteen others."""


def other_gel(count: int, seed: int) -> Dataset:
    """Presses on a gel that is softer, with its camera aside."""
    dataset = presses(count, seed)
    moved = dataset.presses - np.array([ASIDE_MM, 0.0, 0.0, 0.0], np.float32)
    moved[:, 3] /= SOFTER
    return dataclasses.replace(dataset, presses=moved)


def readings() -> dict[str, np.ndarray]:
    """The errors of what each kind of fit reads of presses that it has not seen."""
    dataset, few, bins = presses(220, 1), other_gel(25, 2), BinGrid()
    out, quiet = np.arange(len(dataset.presses)) % 5 == 1, Progress()
    response = fit_response(dataset, out, CONFIG, bins, quiet)
    axisymmetric = fit_axisymmetric(dataset, out, AXISYMMETRIC, bins, quiet)
    made = {
        'response': (response, dataset),
        'axisymmetric': (axisymmetric, dataset),
        'calibrated axisymmetric': (transfer(axisymmetric, few).readout, other_gel(40, 3)),
    }
    read = {name: live_errors(readout, seen, judges(seen)) for name, (readout, seen) in made.items()}
    return {**read, 'field': field_errors()}


def field_errors() -> np.ndarray:
    """The same of a force field, on a small sensor whose regions are not as its description has them."""
    dataset, rows = pressed(pressed_terms(), uneven(), 60), np.arange(60)
    fit = fit_field(SENSOR, quiet_scaling(), dataset, rows[:FEW], rows[:FEW] % 5, BALL)
    assert fit.form == 'regions', fit.reason
    return live_errors(fit.readout, dataset, rows[FEW:])


def judges(dataset: Dataset) -> np.ndarray:
    """Presses that no fit saw, fewer than 60."""
    touched = np.flatnonzero(dataset.presses[:, 2] > 0)
    return touched[touched % 5 == 1] if len(dataset.presses) > 60 else touched


if __name__ == '__main__':
    np.savez(sys.argv[1], **readings())
    print(*kernels())
