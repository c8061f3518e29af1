"""Ablation study: each mechanism is switched off alone, and errors and times are measured with it and without it.

Figures are those of the benchmarks `stability`, `contacts` and `transfer`, and the time of a frame. The mechanisms and
how they are switched off are in `benchmarks.ablation.mechanisms`. A mechanism that improves no figure is removed.
"""

from __future__ import annotations

import argparse
from functools import cache
from typing import TYPE_CHECKING, Any

from benchmarks.ablation.mechanisms import BY_NAME
from benchmarks.ablation.page import page
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Result
from benchmarks.harness.running import Run
from tactile_nodes.paths import share_directory

if TYPE_CHECKING:
    from benchmarks.stability.stream import World


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure one mechanism."""
    import cv2

    from benchmarks.ablation import figures

    cv2.setNumThreads(1)
    (name,) = arguments.only
    mechanism = BY_NAME[name]
    found: dict[str, Any] = {}
    if mechanism.streams:
        found |= figures.streams(mechanism, _world(), run.progress)
    if mechanism.contacts:
        found |= figures.contacts(mechanism, run.progress)
    if mechanism.transfer:
        found |= figures.transfer(mechanism, run.progress)
    return {
        'does': mechanism.does,
        'files': list(mechanism.files),
        'lines': mechanism.lines(share_directory()),
        'stays': mechanism.stays,
        'figures': found,
    }


@cache
def _world() -> World:
    """The gel of the models; its pictures are kept for all mechanisms."""
    from benchmarks.stability.stream import World

    return World()


BENCHMARK = Benchmark(
    name='ablation',
    about=__doc__,
    sources=(
        'benchmarks/ablation/**', 'benchmarks/stability/**', 'benchmarks/contacts/**', 'benchmarks/transfer/**',
        'tactile_nodes/learning/**', *SENSING, *SIMULATED,
    ),
    page=page,
    measure=measure,
    cases=tuple(BY_NAME),
    in_parts=True,
    tasks=True,
    example="""\
examples:
  tactile bench ablation --only 'dead pixels'
  tactile bench ablation -o docs/results""",
)  # fmt: skip
