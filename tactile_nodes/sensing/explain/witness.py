"""A second reader beside a network: one contact's motion, measured in the same presses, and what it says of a frame.

A network answers whatever it is shown, and with directions of the training alone two contacts, a corner or more depth
than was trained look like any press. So the gel's response is measured in the same presses (`sensing.response`): which
one contact explains the motion best, how much does it leave over, and what force would it take?
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.reading import Reading
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.geometry import BinGrid


@dataclass(frozen=True)
class Witness:
    """The measured response to one contact, of features of an encoding taken as motion along x and y."""

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
        """The one contact that explains a frame best, and how unlike any of the training it is."""
        return self.readout.read(as_motion(self.encoding, values), confidence)
