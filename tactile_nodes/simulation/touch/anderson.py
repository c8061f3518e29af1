"""Anderson's acceleration of a fixed-point iteration: the next place is that combination of the last steps whose own
step would be the least (D. G. Anderson, J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011)."""

from __future__ import annotations

from collections import deque

import numpy as np
from jaxtyping import Float


class Anderson:
    """Remembers a few places and steps; `next` says where to go from a place whose plain step is known."""

    def __init__(self, depth: int = 5) -> None:
        self._places: deque[np.ndarray] = deque(maxlen=depth)
        self._steps: deque[np.ndarray] = deque(maxlen=depth)
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def next(self, at: Float[np.ndarray, ' n'], step: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
        """The next place; the first time it is `at + step`."""
        if self._last is not None:
            self._places.append(at - self._last[0])
            self._steps.append(step - self._last[1])
        self._last = at, step
        ahead: np.ndarray = at + step
        if not self._steps:
            return ahead
        normal = np.array([[np.vdot(one, other) for other in self._steps] for one in self._steps], float)
        right = np.array([np.vdot(each, step) for each in self._steps], float)
        normal[np.diag_indices(len(normal))] *= 1 + 1e-8
        for share, place, change in zip(np.linalg.lstsq(normal, right)[0], self._places, self._steps, strict=True):
            ahead = ahead - share.astype(ahead.dtype) * (place + change)
        return ahead
