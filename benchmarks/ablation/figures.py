"""Figures with a mechanism and without it: for streams of the stability benchmark, for contacts, for transfer.

Both chains of a stream get every picture in turn, so that their times are comparable.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.ablation.mechanisms import Mechanism, Switch
from benchmarks.stability.cases import CASES, Case
from benchmarks.stability.chain import Chain, fresh
from benchmarks.stability.scores import OK, Answer, score
from benchmarks.stability.stream import HELD, REST, Change, Plan, World, force_n
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.model import OK_TIMES

if TYPE_CHECKING:
    from benchmarks.transfer.scores import Score

PLAN = Plan(presses=16)
WITH, WITHOUT = 'with', 'without'
CONTACTS_SEED, CONTACTS_EACH = 101, 8
"""Different from those of the page of contacts, because no decision may be based on a test set."""

GELS_SEED, GELS, COUNTS = 4077, (0, 1), (10, 25, 100)
"""Gels that are in no page of transfer."""

Figures = dict[str, dict[str, float]]
"""By figure; values with and without the mechanism."""


@dataclass
class Side:
    """One chain, its forces, and its CPU time for each frame (ms)."""

    switch: Switch
    chain: Chain
    answers: list[Answer]
    spent_ms: list[float]

    @classmethod
    def begun(cls, switch: Switch, profile: str) -> Side:
        """Make the chain under its switch, because models and options are read here."""
        fresh.cache_clear()
        with switch():
            return cls(switch, Chain(profile), [], [])

    def read(self, moment: Any, picture: np.ndarray, values: Any, world: World) -> None:
        """Process one frame, under its switch."""
        with self.switch():
            begun = time.process_time()
            message = self.chain.read(moment.stamp_ns, picture, moment.age_s, values)
            self.spent_ms.append(1e3 * (time.process_time() - begun))
            if (coming := self.chain._following.memory.rest.coming) is not None:
                coming.wait()  # under the same switch
        nominal_n = self.chain.nominal_n(force_n(moment, world.tables))
        self.answers.append(Answer.of(moment, message, world.tables, nominal_n))


def change_of(stream: str) -> Change:
    """The disturbance of a stream: 'blur 1' is the case `blur` at the level 1."""
    if stream == 'none':
        return Change()
    name, _, level = stream.rpartition(' ')
    return _case(name).at(float(level))


def _case(name: str) -> Case:
    return next(each for each in CASES if each.name == name)


def streams(mechanism: Mechanism, world: World, progress: Progress, plan: Plan = PLAN) -> dict[str, Figures]:
    """All figures from the streams of a mechanism, by profile and stream."""
    found: dict[str, Figures] = {}
    with progress.bar(mechanism.name, len(mechanism.streams)) as bar:
        for stream in mechanism.streams:
            for profile, sides in _read(mechanism, stream, world, plan).items():
                figures = {name: _figures(side, change_of(stream)) for name, side in sides.items()}
                found[f'{profile}, {stream}'] = _beside(figures)
            bar.advance(1, stream)
    return found


def _read(mechanism: Mechanism, stream: str, world: World, plan: Plan) -> dict[str, dict[str, Side]]:
    change = change_of(stream)
    switches = {WITH: nullcontext, WITHOUT: mechanism.off}
    sides = {
        profile: {name: Side.begun(switch, profile) for name, switch in switches.items()}
        for profile in mechanism.profiles
    }
    for moment, picture in world.frames(change, plan):
        values = change.values if change.acts(moment) else None
        for both in sides.values():
            for side in both.values():
                side.read(moment, picture, values, world)
    fresh.cache_clear()
    return sides


def _beside(sides: Mapping[str, dict[str, float]]) -> Figures:
    """The figures of both sides, by figure."""
    return {figure: {name: sides[name][figure] for name in sides} for figure in sides[WITH]}


def _figures(side: Side, change: Change) -> dict[str, float]:
    """Figures of a stream during its disturbance: its score, the share wrong while ok, and the time of a frame."""
    found = score(side.answers, change)
    timed = list(zip(side.answers, side.spent_ms, strict=True))
    held, rest = (
        [pair for pair in timed if pair[0].moment.kind == kind and (change.endless or change.acts(pair[0].moment))]
        for kind in (HELD, REST)
    )
    wrong = [answer.status == OK and not abs(answer.times) <= OK_TIMES for answer, _ in held]
    return {
        'force error, mN': 1e3 * (math.nan if found.rmse_n is None else found.rmse_n),
        'place, mm': math.nan if found.place_mm is None else found.place_mm,
        'frames ok': found.held_ok,
        'wrong while ok': float(np.mean(wrong)),
        'false contacts': found.false_share,
        'CPU in contact, ms': float(np.median([spent for _, spent in held])),
        'CPU at rest, ms': float(np.median([spent for _, spent in rest])),
    }


def contacts(mechanism: Mechanism, progress: Progress) -> dict[str, Figures]:
    """Figures for any contact, estimated with the shipped model `field`."""
    sides = {WITH: _contact_errors(nullcontext, progress), WITHOUT: _contact_errors(mechanism.off, progress)}
    return {'field, any contact': _beside(sides)}


@cache
def _contact_errors(switch: Switch, progress: Progress) -> dict[str, float]:
    from benchmarks.contacts import read
    from benchmarks.contacts.cases import solved, wanted
    from benchmarks.contacts.frames import CONDITIONS
    from benchmarks.contacts.scores import summed
    from tactile_nodes.simulation.gel import Gel

    gel = Gel(seed=1)
    chosen = [solved(each) for each in wanted(gel, CONTACTS_SEED, CONTACTS_EACH).values()]
    fresh.cache_clear()
    with switch():
        scores, _ = read({'field': 'field'}, gel, chosen, CONDITIONS[0], progress)
    fresh.cache_clear()
    found = summed(scores['field'])
    return {
        'misplaced': found['misplaced'], 'total, mN': 1e3 * found['total_rms_n'],
        'centre, mm': found['centre_mm_median'],
        'shear': found['shear_median'], 'torsion': found['torsion_median'], '1 - map r': 1 - found['map_r'],
        'frames ok': found['ok'], 'worst while ok': found['worst_while_ok'], 'CPU in contact, ms': found['cpu_ms'],
        'CPU, 95 %, ms': found['cpu_95_ms'],
    }  # fmt: skip


TRANSFERRED = {
    'force error, mN': ('force_rmse_n', 1e3), 'place, mm': ('place_median_mm', 1.0),
    'aRMSE, any grid, mN': ('placed_armse_n', 1e3),
}  # fmt: skip


def transfer(mechanism: Mechanism, progress: Progress) -> dict[str, Figures]:
    """Figures for `portable`, calibrated for other gels with a few presses: means over the gels."""
    sides = {WITH: _transferred(nullcontext, progress), WITHOUT: _transferred(mechanism.off, progress)}
    return {
        f'portable, another gel, {count} presses': _beside({
            name: _means([each for each in scores if each.presses == count]) for name, scores in sides.items()
        })
        for count in COUNTS
    }  # fmt: skip


def _means(scores: Sequence[Score]) -> dict[str, float]:
    return {
        figure: unit * float(np.mean([getattr(each, measure) for each in scores]))
        for figure, (measure, unit) in TRANSFERRED.items()
    }


@cache
def _transferred(switch: Switch, progress: Progress) -> list[Score]:
    from benchmarks.transfer import measure
    from benchmarks.transfer.scores import CALIBRATED
    from tactile_nodes.pipeline.ready_model import Ready

    with switch():
        loaded = Ready.read('portable').loaded
        _, scores = measure(loaded, GELS, progress, seed=GELS_SEED, counts=COUNTS)
    return [each for each in scores if each.way == CALIBRATED]
