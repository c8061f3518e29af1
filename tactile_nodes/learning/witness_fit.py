"""Measure the witness of a network: the response to one contact, in the presses that the network learns from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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


def with_witness(
    readout: NetworkReadout,
    dataset: Dataset,
    held_out: np.ndarray,
    encoding: str,
    progress: Progress,
    config: ResponseConfig = CONFIG,
) -> NetworkReadout:
    """The readout with a witness that saw what is not held out.

    Without one, and told so, where the presses are no ground for it, or Ctrl-C ended the wait.
    """
    motion = replace(dataset, features=as_motion(encoding, dataset.features).astype(np.float16))
    try:
        response = fit_response(motion, held_out, config, readout.bins, progress)
    except (DatasetError, KeyboardInterrupt) as error:
        why = str(error) or 'stopped'
        progress.say(f'the network has no witness, so contacts that it does not know may pass for known ones: {why}')
        return replace(readout, witness=None)
    return replace(readout, witness=Witness(response, encoding, margin_n=readout.spread.floor_n))
