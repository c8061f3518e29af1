"""Fit the novelty check of a network: the response to one contact, from the network's training presses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.fit import fit_response
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.shapes import Float32

CONFIG = ResponseConfig(components=40, spacing_mm=2.0, levels=6, most_contacts=1)
"""As in the profile `fast`."""

PRESSES_PER_PLACE = 8
"""Least presses per spline interval, as many as in the paper's plan; fewer presses give a wider spacing."""


def config_for(presses: Float32[np.ndarray, 'samples 4']) -> ResponseConfig:
    """Spline spacing by the number of presses: 2 mm for 10952 presses over 27 mm, 3.9 mm for 392 (seven per side)."""
    touched = presses[presses[:, 2] > 0]
    side_mm = float(np.ptp(touched[:, :2], axis=0).max()) if len(touched) else 0.0
    apart_mm = side_mm / math.sqrt(max(len(touched) / PRESSES_PER_PLACE, 1.0))
    return replace(CONFIG, spacing_mm=max(CONFIG.spacing_mm, apart_mm))


def with_novelty_check(
    readout: NetworkReadout,
    dataset: Dataset,
    held_out: np.ndarray,
    encoding: str,
    progress: Progress,
    config: ResponseConfig | None = None,
) -> NetworkReadout:
    """The readout with a novelty check, fitted to the samples that are not held out.

    If the presses do not suffice or Ctrl-C ended the fit, it is returned without one, and this is reported.
    """
    motion = replace(dataset, features=as_motion(encoding, dataset.features).astype(np.float16))
    try:
        response = fit_response(motion, held_out, config or config_for(dataset.presses), readout.bins, progress)
    except (DatasetError, KeyboardInterrupt) as error:
        why = str(error) or 'stopped'
        progress.say(f'the network has no novelty check, so unknown contacts may be mistaken for known ones: {why}')
        return replace(readout, novelty_check=None)
    return replace(readout, novelty_check=NoveltyCheck(response, encoding))
