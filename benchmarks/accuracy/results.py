"""What `tactile bench accuracy` measures of some models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_nodes.learning.evaluation.evaluate import Evaluation


@dataclass(frozen=True)
class Results:
    """What was measured of some models; the evaluations are in the models' order.

    `aside` is on what the training of the `paper` plan's model put aside, and empty if none of the models has one.
    """

    plain: dict[str, Any]
    off_grid: Sequence[Evaluation]
    aside: Sequence[Evaluation]
    curve: Sequence[Evaluation]
