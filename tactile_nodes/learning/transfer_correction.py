"""How much of the known gel's correction of forces belongs to another gel too.

Part of what profiles that are alike in all directions get wrong is alike on all gels: towards the rim of the image a
region sees markers in a streak, so that presses towards and away from the middle move it more than those beside it.
The rest follows from the known gel's own markers.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.axisymmetric_calibration import LEAST_FORCE_N, Judged
from tactile_nodes.sensing.axisymmetric_readout import Correction

EXPECTED, SPREAD = 0.75, 0.5
"""The share that is expected before any press, and its standard deviation: on three development gels the best share was
0.1 to 0.75 with 25 presses and 1.0 to 1.3 with 100."""
LARGEST = 1.25
"""More of what was learnt on one gel is not trusted on another."""
NOISE_N, NOISE_SHARE = 0.002, 0.01
"""By how much forces of held-out presses are off beside what a correction removes: newtons, and a share of them."""
OUTLIER = 2.5
"""Times that noise: what is off by more counts less."""


def carried_share(known: Correction, held: list[Judged]) -> float:
    """The share of the known gel's correction of forces that is likeliest by presses which no fit saw.

    What they ask for, by how sure it is, against the share that is expected of any gel.
    """
    told = np.concatenate([_told(known, each) for each in held])
    missing = np.concatenate([each.truth[:, 2] - each.found[:, 2] for each in held])
    force = np.concatenate([each.found[:, 2] for each in held])
    noise = np.hypot(NOISE_N, NOISE_SHARE * force)
    certainty = np.minimum(1.0, OUTLIER * noise / np.maximum(np.abs(missing), 1e-9)) / noise**2
    square = float(certainty @ told**2)
    if square == 0 or len(told) < 2:
        return 0.0
    share = float(certainty @ (told * missing)) / square
    spread = float(np.sqrt(np.mean(certainty * (missing - share * told) ** 2) / square))
    trust = SPREAD**2 / (SPREAD**2 + spread**2)
    return float(np.clip(EXPECTED + trust * (share - EXPECTED), 0.0, LARGEST))


def _told(known: Correction, judged: Judged) -> Float[np.ndarray, ' n']:
    """What the correction adds to the forces found (N)."""
    response = judged.readout.response
    found = judged.found / np.array([response.width, response.width, 1 / response.softness])
    share = Correction.powers(found, known.reach_mm, known.hardest_n) @ known.terms[:, 2]
    told: np.ndarray = share * np.maximum(judged.found[:, 2], LEAST_FORCE_N)
    return told
