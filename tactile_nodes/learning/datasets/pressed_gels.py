"""Simulated presses on gels other than a known one: as in a calibration, and anywhere."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tactile_nodes.collection.plan.plan import load_plan_settings, plan_path
from tactile_nodes.learning.config import DataConfig, TrainConfig
from tactile_nodes.learning.datasets.held_presses import simulate_held
from tactile_nodes.learning.datasets.holds import holds_of
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.simulation.other_gels import LEARNED_SEED, other_gel

PRESSES_SEED = 5001
FRAMES, WITHOUT_CONTACT, UNTOUCHED = 400, 0.2, 20
PICTURES = 8
"""Images of each press in a calibration: as many as config/calibrate.yaml has the rig take."""
PLAN, PLANNED = 'calibrate', 100


def pressed_gel(config: TrainConfig, number: int) -> tuple[Dataset, Dataset]:
    """One of the gels to learn from, with the camera, flow and features of a configuration.

    Returns presses by the plan of a calibration, and presses anywhere.
    """
    other = dataclasses.replace(config, gel=other_gel(config.gel, number, LEARNED_SEED))
    return planned(other, Progress(), PICTURES), anywhere(other, Progress())


def planned(config: TrainConfig, progress: Progress, pictures: int = 1) -> Dataset:
    """The first presses of the plan of a calibration and some images of the untouched gel, with one rest image.

    Each press is held for `pictures` images.
    """
    plan = load_plan_settings(plan_path(PLAN))
    return _simulated(
        config, progress, pictures, plan=plan.kind, presses=PLANNED, seed=plan.seed, reach_mm=plan.reach_mm,
        shallowest_mm=min(plan.depths_mm), deepest_mm=max(plan.depths_mm),
        without_contact=UNTOUCHED / (PLANNED + UNTOUCHED),
    )  # fmt: skip


def anywhere(config: TrainConfig, progress: Progress, frames: int = FRAMES, seed: int = PRESSES_SEED) -> Dataset:
    """Presses at random places and depths. The same seed gives the same presses on every gel."""
    return _simulated(
        config, progress, presses=frames, seed=seed, reach_mm=13.5, shallowest_mm=0.25, deepest_mm=2.0,
        without_contact=WITHOUT_CONTACT,
    )  # fmt: skip


def _simulated(config: TrainConfig, progress: Progress, pictures: int = 1, **data: Any) -> Dataset:
    settings = DataConfig(presses_per_rest_image=0, processes=1, crop=config.data.crop, **data)
    return simulate_held(dataclasses.replace(config, data=settings), pictures, progress)


def first_presses(dataset: Dataset, presses: int, *, pictures: int | None = None) -> Dataset:
    """The first presses, and some images of the untouched gel, which cost a rig no time.

    Only the first `pictures` of each press are kept; None: all.
    """
    touched = dataset.presses[:, 2] > 0
    holds = holds_of(dataset, np.flatnonzero(touched))[:presses]
    chosen = np.concatenate([*(each[:pictures] for each in holds), np.flatnonzero(~touched)[:UNTOUCHED]])
    return dataset.take(np.sort(chosen))
