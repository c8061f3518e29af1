"""Measure the witness of a network: the response to one contact, in the presses that the network learns from."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.response_fit import fit_response
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.network import NetworkReadout
from tactile_nodes.sensing.witness import Witness

CONFIG = ResponseConfig(components=40, spacing_mm=2.0, levels=6, most_contacts=1)
"""As the profile `fast` has it."""

MARGIN = 2.0
"""Of the network's least uncertainties: a contact so near to the hardest one of the training is beyond it."""

RINGS_MM = (0.5, 1.0, 1.5, 2.0)
LEAST_IN_RING, TWICE = 20, 2.0

PRESSES_PER_PLACE = 8
"""Splines lie further apart where fewer presses than this would tell of each place: the paper's plan has so many."""


def config_for(presses: Float32[np.ndarray, 'samples 4']) -> ResponseConfig:
    """Of 10952 presses over 27 mm splines are 2 mm apart, of 392 3.9 mm: seven places along each side."""
    touched = presses[presses[:, 2] > 0]
    side_mm = float(np.ptp(touched[:, :2], axis=0).max()) if len(touched) else 0.0
    apart_mm = side_mm / math.sqrt(max(len(touched) / PRESSES_PER_PLACE, 1.0))
    return replace(CONFIG, spacing_mm=max(CONFIG.spacing_mm, apart_mm))


def with_witness(
    readout: NetworkReadout,
    dataset: Dataset,
    held_out: np.ndarray,
    encoding: str,
    progress: Progress,
    config: ResponseConfig | None = None,
) -> NetworkReadout:
    """The readout with a witness that saw what is not held out.

    Without one, and told so, where the presses are no ground for it, or Ctrl-C ended the wait.
    """
    motion = replace(dataset, features=as_motion(encoding, dataset.features).astype(np.float16))
    try:
        response = fit_response(motion, held_out, config or config_for(dataset.presses), readout.bins, progress)
    except (DatasetError, KeyboardInterrupt) as error:
        why = str(error) or 'stopped'
        progress.say(f'the network has no witness, so contacts that it does not know may pass for known ones: {why}')
        return replace(readout, witness=None)
    errors_n, judges = judged(readout, dataset, held_out)
    rim_mm = unsure_rim_mm(errors_n, judges)
    return replace(readout, witness=Witness(response, encoding, MARGIN * readout.spread.floor_n, rim_mm))


def judged(
    readout: NetworkReadout, dataset: Dataset, held_out: np.ndarray
) -> tuple[Float[np.ndarray, ' judges'], Float32[np.ndarray, 'judges 4']]:
    """The network's errors of the total on presses held out, and these presses."""
    chosen = np.flatnonzero(held_out & (dataset.presses[:, 2] > 0))
    features, confidence = dataset.features[chosen].astype(np.float32), dataset.confidence[dataset.rest[chosen]]
    inputs = [readout.inputs(*each) for each in zip(features, confidence, strict=True)]
    found_n = [readout.network(each).sum() * readout.output_scale_n for each in inputs]
    return np.array(found_n, float) - dataset.presses[chosen, 3], dataset.presses[chosen]


def unsure_rim_mm(errors_n: Float[np.ndarray, ' judges'], presses: Float32[np.ndarray, 'judges 4']) -> float:
    """How far from the end of the pressed places a network errs twice as much as within: in rings of half a millimetre.

    There presses teach it from one side only. 0 where it does not, or where a ring holds too few presses to tell.
    """
    if not len(presses):
        return 0.0
    places = np.abs(presses[:, :2] - (presses[:, :2].max(axis=0) + presses[:, :2].min(axis=0)) / 2)
    inwards = (np.ptp(presses[:, :2], axis=0) / 2 - places).min(axis=1)
    within = float(np.sqrt(np.mean(errors_n[inwards >= RINGS_MM[-1]] ** 2))) if (inwards >= RINGS_MM[-1]).any() else 0.0
    rim_mm = 0.0
    for outer, inner in itertools.pairwise((0.0, *RINGS_MM)):
        ring = errors_n[(inwards >= outer) & (inwards < inner)]
        if len(ring) < LEAST_IN_RING or not np.sqrt(np.mean(ring**2)) > TWICE * within > 0:
            break
        rim_mm = inner
    return rim_mm
