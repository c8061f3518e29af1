"""Images and turns for nodes that are fed by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus.node.node import Node

START_NS = 1_000_000_000_000
RNG = np.random.default_rng(5)
PATTERN = np.repeat(np.repeat(RNG.integers(20, 200, (80, 80), dtype=np.uint8), 2, 0), 2, 1)
"""160x160 pixels with structure in every region."""


def run(node: Node) -> None:
    """Let a node do all that it has to do now."""
    while node._work.qsize():
        node.spin_once()


def image(pixels: np.ndarray, stamp_ns: int = START_NS) -> Any:
    return conversions.image_message(pixels, conversions.header(stamp_ns, 'camera'))
