"""Two tips at once: are both places and both forces found, and how near to each other may they be?

The simulated gel adds up the motion of its contacts (superposition), as the readout assumes; a real gel does so only
as long as its strains are small and the contacts well apart. So this judges how far two known answers can be told
apart in the noise, and not how well a real gel obeys.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tactile_nodes import paths
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.learning.config import DataConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import recipe_id
from tactile_nodes.learning.evaluation.scores import percentile, share
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.pipeline.judge_force import FORCE, judged_alone
from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.optics import Optics, Press, mix

RECIPE = 1
"""Raised when the code below gives other samples for the same configuration."""
LIGHTEST_MM, DEEPEST_MM = 0.3, 1.5
DISTANCES_MM = (2.5, 5.0, 7.5, 10.0, 12.5, 15.0)
"""Borders of the groups; distances are drawn evenly from the first to the last."""
PLACE_MM = 1.0
FORCE_SHARE = 0.2
ALL = 'all pairs'


@dataclass(frozen=True)
class Pairs:
    """Frames with two tips: features and confidence of each, and x, y (mm), depth (mm) and force (N) of its tips."""

    values: Float[np.ndarray, 'pairs rows cols channels']
    confidence: Float[np.ndarray, 'pairs rows cols']
    tips: Float[np.ndarray, 'pairs 2 4']

    @property
    def distance_mm(self) -> Float[np.ndarray, ' pairs']:
        apart = self.tips[:, 1, :2] - self.tips[:, 0, :2]
        distance: np.ndarray = np.hypot(apart[:, 0], apart[:, 1])
        return distance


@dataclass(frozen=True)
class PairScores:
    """What a model says of pairs: shares of them, and the 95th percentile of the total's error.

    `found`: both places within 1 mm and both forces within 20 %. `placed`: both places, whatever the forces. `counted`:
    just two contacts reach the model's threshold. `wrong`: neither found nor flagged as unlike, so believed. `ok` and
    `degraded`: what the force topic would call them; `held`: the total lies within the 90 % interval told.
    """

    pairs: int
    found: float
    placed: float
    counted: float
    flagged: float
    wrong: float
    ok: float
    degraded: float
    held: float
    total_p95_n: float


def score_pairs(loaded: LoadedModel, config: TrainConfig, pairs: int, progress: Progress) -> dict[str, PairScores]:
    """Scores over pairs of tips, all and by their distance; `config` says gel, flow, features and seed."""
    seen = simulated_pairs(config, pairs, progress)
    estimator, encoding = ForceEstimator(loaded.model), loaded.model.layout.encoding
    answers = [
        estimator.predict(Features(encoding, values, confidence))
        for values, confidence in zip(seen.values, seen.confidence, strict=True)
    ]
    verdicts = np.array(
        [judged(tips, each, loaded.model.contact_threshold_n) for tips, each in zip(seen.tips, answers, strict=True)]
    )
    return {name: _scores(verdicts[who]) for name, who in _groups(seen.distance_mm).items() if who.any()}


def judged(tips: Float[np.ndarray, '2 4'], found: ForceMap, threshold_n: float) -> tuple[float, ...]:
    """Found, placed, counted, flagged, ok, degraded, held (1 or 0), and the error of the total (N)."""
    contacts = [each for each in found.contacts if each.force_n >= threshold_n]
    placed = near = False
    for first, second in ((0, 1), (1, 0)) if len(contacts) >= 2 else ():
        pairs = [(contacts[0], tips[first]), (contacts[1], tips[second])]
        if all(_away_mm(*pair) <= PLACE_MM for pair in pairs):
            placed, near = True, all(_force_fits(*pair) for pair in pairs)
    told, off_n = judged_alone(found), abs(found.total_n - tips[:, 3].sum())
    ok, degraded = (told.status == each for each in (FORCE.STATUS_OK, FORCE.STATUS_DEGRADED))
    held = off_n <= metrics.interval_factor(metrics.INTERVAL) * told.sigma_n
    return near, placed, len(contacts) == 2, found.unlikeness > 1, ok, degraded, held, off_n


def _away_mm(contact: Contact, tip: np.ndarray) -> float:
    return float(np.hypot(contact.x_mm - tip[0], contact.y_mm - tip[1]))


def _force_fits(contact: Contact, tip: np.ndarray) -> bool:
    return bool(abs(contact.force_n - tip[3]) <= FORCE_SHARE * tip[3])


def _groups(distance_mm: Float[np.ndarray, ' pairs']) -> dict[str, np.ndarray]:
    bands = pairwise(DISTANCES_MM)
    by_distance = {f'{low:g} to {high:g} mm apart': (distance_mm >= low) & (distance_mm < high) for low, high in bands}
    return {ALL: np.ones(len(distance_mm), bool), **by_distance}


def _scores(verdicts: Float[np.ndarray, 'pairs 8']) -> PairScores:
    found, placed, counted, flagged, ok, degraded, held = verdicts[:, :7].T.astype(bool)
    return PairScores(
        pairs=len(verdicts),
        found=share(found),
        placed=share(placed),
        counted=share(counted),
        flagged=share(flagged),
        wrong=share(~found & ~flagged),
        ok=share(ok),
        degraded=share(degraded),
        held=share(held),
        total_p95_n=percentile(verdicts[:, 7], 95),
    )


def planned_pairs(data: DataConfig, pairs: int) -> list[tuple[Press, Press]]:
    """Pairs of every distance, direction and depth alike, both tips within the reach of the configuration."""
    random = np.random.default_rng([data.seed, 2])
    planned = []
    for distance_mm in random.uniform(DISTANCES_MM[0], DISTANCES_MM[-1], pairs).tolist():
        x, y, other_x, other_y = _ends(random, distance_mm, data.reach_mm)
        depth, other_depth = random.uniform(LIGHTEST_MM, DEEPEST_MM, 2).tolist()
        planned.append((Press(x, y, depth), Press(other_x, other_y, other_depth)))
    return planned


def _ends(random: np.random.Generator, distance_mm: float, reach_mm: float) -> list[float]:
    """x and y of two places within the reach; their distance is kept while they are drawn, lest far ones be rare."""
    while True:
        angle = random.uniform(0, 2 * np.pi)
        first = random.uniform(-reach_mm, reach_mm, 2)
        second = first + distance_mm * np.array([np.cos(angle), np.sin(angle)])
        if np.abs(second).max() <= reach_mm:
            return [*first.tolist(), *second.tolist()]


def simulated_pairs(config: TrainConfig, pairs: int, progress: Progress) -> Pairs:
    """The frames of `planned_pairs` against one rest image; what was made before is read."""
    folder = paths.cache_directory() / 'datasets' / 'pairs'
    folder.mkdir(parents=True, exist_ok=True)
    key = hashlib.sha256(json.dumps([RECIPE, recipe_id(config), pairs]).encode()).hexdigest()[:16]
    file = folder / f'{key}.npz'
    if not file.is_file():
        draft = file.with_suffix(f'.{os.getpid()}.part.npz')
        _render(config, pairs, draft, progress)
        draft.replace(file)
    with np.load(file, allow_pickle=False) as arrays:
        return Pairs(arrays['values'], arrays['confidence'], arrays['tips'])


def _render(config: TrainConfig, pairs: int, file: Path, progress: Progress) -> None:
    table = contact_table(config.gel)
    optics, size = Optics(config.gel, table), config.data.crop
    flow, encoding = config.make_flow(), config.make_encoding()
    first, frames = mix(config.data.seed), config.data.frames_per_rest_image
    rest = average([centre_crop(optics.render((), first + number), size, size) for number in range(frames)])
    flow.set_reference(rest)
    encoding.set_reference(rest)
    values, confidence, tips = [], [], []
    with progress.bar('rendering pairs', pairs) as bar:
        for number, presses in enumerate(planned_pairs(config.data, pairs)):
            image = centre_crop(optics.render(presses, first + frames + number), size, size)
            encoded = encoding.encode(flow.displacement(image))
            values.append(encoded.values)
            confidence.append(encoded.confidence)
            tips.append([(each.x_mm, each.y_mm, each.depth_mm, table.force_at(each.depth_mm)) for each in presses])
            bar.advance()
    np.savez(file, values=np.stack(values), confidence=np.stack(confidence), tips=np.array(tips))
