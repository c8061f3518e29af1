"""The shipped models as a launch runs them, from image to force message, with the presses of the chart's test frames.

Each press is held for a few frames after some without contact. The chains take these frames in turn, each all of them
in sequence, as each sensor has its own process. The time of the last frame counts, when the chain has settled.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.front.frames import Plan, cropped, tested_presses
from benchmarks.harness.report import in_turn, quartiles
from benchmarks.stability.chain import REST_FRAMES, Chain
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

RATE_HZ = 60
FREE_FRAMES, HELD_FRAMES = 4, 5
"""Frames between two presses, and of each press."""

SEED = 3_000_000
"""Noise that no test frame has."""


def measure_chains(models: Sequence[tuple[str, bool]], plan: Plan, progress: Progress) -> list[dict[str, float]]:
    """Median and quartiles of the CPU time (ms) of a frame in contact for each model, compiled or not."""
    gel = Gel()
    optics, presses = Optics(gel, contact_table(gel)), [press for press in tested_presses(plan) if press.touching]
    chains = [(number, Chain(model, compiled=compiled)) for number, (model, compiled) in enumerate(models)]
    found: list[list[float]] = [[] for _ in chains]
    count = 0

    def pictures(shown: tuple[Press, ...], frames: int) -> list[tuple[int, np.ndarray]]:
        nonlocal count
        first, count = count + 1, count + frames
        return [(n * NS_PER_S // RATE_HZ, cropped(optics.render(shown, SEED + n))) for n in range(first, count + 1)]

    for stamp_ns, picture in pictures((), REST_FRAMES + RATE_HZ // 2):
        for _, chain in chains:
            chain.read(stamp_ns, picture)
    with progress.bar('the chains of a launch', len(presses)) as bar:
        for turn, press in enumerate(presses):
            stream = pictures((), FREE_FRAMES) + pictures((press,), HELD_FRAMES)
            for number, chain in in_turn(chains, turn):
                for stamp_ns, picture in stream:
                    begun = time.process_time_ns()
                    chain.read(stamp_ns, picture)
                    took_ms = (time.process_time_ns() - begun) * 1e-6
                found[number].append(took_ms)
            bar.advance()
    return [quartiles(times) for times in found]
