"""A novelty check (out-of-distribution detector) beside a network: the gel's response to one contact.

A network gives an answer for any input, and the directions of the training alone do not distinguish two contacts, a
corner or a deeper press from a usual one. So the gel's response is measured in the same presses (`explain.measured`):
which single contact explains the motion best, how large is the residual, and which force does it have?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.reading import Reading
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32


@dataclass(frozen=True)
class NoveltyCheck:
    """The measured response to one contact; features of `encoding` are converted to motion along x and y."""

    readout: ResponseReadout
    encoding: str

    kind = 'witness'

    @property
    def parameter_count(self) -> int:
        return self.readout.parameter_count

    def nominal_n(self, total_n: float) -> float:
        return self.readout.nominal_n(total_n)

    def require_fit(self, features: int, bins: BinGrid) -> None:
        """Refuse features or bins that it was not made for. Raises ModelError."""
        self.readout.require_fit(features, bins)

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        """The single contact that explains a frame best, and the novelty of the frame."""
        return self.readout.read(as_motion(self.encoding, values), confidence)
