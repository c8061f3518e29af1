"""The results of `tactile bench transfer_paper`: the paper's metrics by calibration, gel, presses and test."""

from __future__ import annotations

from dataclasses import dataclass

GROUP = 100
"""Presses in a group. aRMSE falls with the number of presses, so all tests are means over groups of about this size."""
REST, NEW = 'rest of the 800', 'new places'
AS_IT_IS, PUBLISHED, TENTH, OURS = 'no calibration', 'published layer', 'a tenth of its rate', 'layer as it ships'
SCRATCH = 'from scratch'
WAYS = (AS_IT_IS, PUBLISHED, TENTH, OURS, SCRATCH)
METRICS = {'armse_n': 'aRMSE, N', 'd_loc_mm': 'd_loc, mm', 'rmse_mc_n': 'RMSE_mc, N'}
OWN = -1
"""The number of the source's own gel."""


@dataclass(frozen=True)
class Score:
    """The paper's metrics of one readout on one test; for a fitted readout also the best epoch and the seconds."""

    gel: int
    presses: int
    way: str
    tested: str
    armse_n: float
    d_loc_mm: float
    rmse_mc_n: float
    best_epoch: int = 0
    epochs: int = 0
    seconds: float = 0.0
