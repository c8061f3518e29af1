"""A second reader beside a network: one contact's motion, measured in the same presses, and what it says of a frame.

A network answers whatever it is shown, and with directions of the training alone two contacts, a corner or more depth
than was trained look like any press. So the gel's response is measured in the same presses (`sensing.response`): which
one contact explains the motion best, how much does it leave over, and what force would it take?
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32

from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.reading import BEYOND_UNLIKENESS, Contact, Reading
from tactile_nodes.sensing.response_readout import ResponseReadout


@dataclass(frozen=True)
class Witness:
    """The measured response to one contact, of features of an encoding taken as motion along x and y.

    `margin_n`: a contact so near to the hardest that the training pressed may as well be harder, and is beyond it.
    `rim_mm`: so near to the end of the trained places along x or y the network is no good on its own presses.
    """

    readout: ResponseReadout
    encoding: str
    margin_n: float = 0.0
    rim_mm: float = 0.0

    kind = 'witness'

    @property
    def parameter_count(self) -> int:
        return self.readout.parameter_count

    def nominal_n(self, total_n: float) -> float:
        return self.readout.nominal_n(total_n)

    @property
    def hardest_n(self) -> float:
        """The largest force of the training."""
        return self.readout.response.force_n(self.readout.response.s.high)

    def require_fit(self, features: int, bins: BinGrid) -> None:
        """Refuse features or bins that it was not made for. Raises ModelError."""
        self.readout.require_fit(features, bins)

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        """The one contact that explains a frame best, and how unlike any of the training it is."""
        found = self.readout.read(as_motion(self.encoding, values), confidence)
        if self._beyond(found.contacts[0]):
            return replace(found, unlikeness=max(found.unlikeness, BEYOND_UNLIKENESS))
        return found

    def _beyond(self, contact: Contact) -> bool:
        """Whether a contact lies at the end of what was trained, in force or place; none without force does."""
        if contact.force_n >= self.hardest_n - self.margin_n:
            return True
        low, high = self.inner_mm
        return contact.force_n > 0 and not (low[0] <= contact.x_mm <= high[0] and low[1] <= contact.y_mm <= high[1])

    @property
    def inner_mm(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest x and y within the rim."""
        x, y, rim = self.readout.response.x, self.readout.response.y, self.rim_mm
        return (x.low + rim, y.low + rim), (x.high - rim, y.high - rim)
