"""Contacts of the ten families with the paper's gel: random bodies, forces, drags and twists. Solutions are cached."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_nodes.contact_tables.touch_tables import first_solved, random_ways
from tactile_nodes.learning.progress import Progress
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.touch.body import Body, grid
from tactile_nodes.simulation.touch.families import FAMILIES, make_body, rectangle
from tactile_nodes.simulation.touch.table import Touch, TouchTable
from tactile_nodes.simulation.touch.track import Way

LIGHTEST_N, HARDEST_N = 0.05, 3.0
HARDEST_OF = {'tip': 1.0}
"""The force [N] that presses the paper's tip 2 mm deep; the other families are pressed with up to 3 N."""

BROAD, BROAD_N = 'flat 20x20 mm', (2.0, 5.0, 10.0)

RIM_MM = 1.0
"""Distance of every contact from the rim of the surface."""


@dataclass(frozen=True)
class Case:
    """A contact for the test: its family, its place and stage, and its solution."""

    family: str
    number: int
    touch: Touch
    table: TouchTable

    @property
    def name(self) -> str:
        return self.touch.body


@dataclass(frozen=True)
class Wanted:
    """A contact that is not yet solved: a task."""

    gel: Gel
    seed: int
    place: int
    family: str
    number: int


def wanted(gel: Gel, seed: int, per_family: int) -> dict[str, Wanted]:
    """`per_family` contacts of each family, by name; a seed gives the same contacts on every machine."""
    return {
        f'{family} {number}': Wanted(gel, seed, place, family, number)
        for number in range(per_family) for place, family in enumerate(FAMILIES)
    }  # fmt: skip


def broad_cases(gel: Gel, progress: Progress | None = None) -> list[Case]:
    """A flat square of 20 mm at 2, 5 and 10 N. It is so wide that under its middle the layer hardly moves."""
    found = []
    body = Body.of_heights(BROAD, rectangle(20.0, 20.0, *grid(12.0)))
    with (progress or Progress()).bar('solving broad contacts', len(BROAD_N)) as bar:
        for number, force_n in enumerate(BROAD_N):
            way = Way(force_mm2=round(force_n / gel.shear_modulus_mpa, 6), press_stages=2)
            table = first_solved(gel, body, [way])
            touch = Touch(f'{BROAD}-{number}', 1.0, -1.0, 0.2, float(table.stages - 1))
            found.append(Case(f'{BROAD}, {force_n:g} N', number, touch, table))
            bar.advance()
    return found


def solved(job: Wanted) -> Case:
    """Solve one contact; if the body strains the gel too much, the force is halved."""
    gel, family, number = job.gel, job.family, job.number
    random = np.random.default_rng([job.seed, job.place, number])
    body, hardest = make_body(family, random), HARDEST_OF.get(family, HARDEST_N)
    force_n = LIGHTEST_N + (hardest - LIGHTEST_N) * float(random.uniform()) ** 1.5
    ways = random_ways(random, gel, force_n, LIGHTEST_N)
    at_mm, turn_rad = random.uniform(-1, 1, 2), float(random.uniform(0, math.tau))
    table = first_solved(gel, body, ways)
    extent = float(np.hypot(*table.node_mm.T).max(initial=0.0))
    reach = np.maximum(np.array(gel.sides_mm) / 2 - RIM_MM - extent, 0.0)
    x_mm, y_mm = (at_mm * reach).tolist()
    touch = Touch(f'{family}-{job.seed}-{number}', x_mm, y_mm, turn_rad, float(table.stages - 1))
    return Case(family, number, touch, table)
