"""Images and turns for nodes that are fed by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus.node.arguments import NodeArguments, parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.messages import types
from tactile_nodes.params import Located, NodeParameters

START_NS = 1_000_000_000_000
RNG = np.random.default_rng(5)
PATTERN = np.repeat(np.repeat(RNG.integers(20, 200, (80, 80), dtype=np.uint8), 2, 0), 2, 1)
"""160x160 pixels with structure in every region."""


def run(node: Node) -> None:
    """Let a node do all that it has to do now."""
    while node._work.qsize():
        node.spin_once()


def given(*parameters: str) -> NodeArguments:
    """What a program gets from these words, as `name:=value`."""
    return parse_arguments(['--ros-args', *(word for each in parameters for word in ('-p', each))])


def located(**values: object) -> NodeArguments:
    """The same of values."""
    found = {name: Located(value, 'test') for name, value in values.items()}
    return NodeArguments(parameters=(NodeParameters('/**', found),))


def image(pixels: np.ndarray, stamp_ns: int = START_NS) -> Any:
    return conversions.image_message(pixels, conversions.header(stamp_ns, 'camera'))


def taken(subscription: Subscription) -> list[Any]:
    """The messages that came since."""
    return [received.message for received in iter(subscription.take, None)]


def came(subscription: Subscription) -> Any:
    """The next message, which must have come."""
    received = subscription.take()
    assert received is not None, f'nothing on {subscription.topic}'
    return received.message


def features(
    stamp_ns: int = START_NS,
    rows: int = 4,
    side: int = 160,
    confidence: float = 1.0,
    reasons: int = 0,
    method: str = '',
) -> Any:
    """Of four columns of regions that did not move."""
    return types.FlowFeatures(
        header=conversions.header(stamp_ns, 'camera'), rows=rows, cols=4, channels=2, encoding='cartesian_mean',
        values=np.zeros(rows * 8, np.float32), confidence=np.full(rows * 4, confidence, np.float32),
        image_width=side, image_height=side, reference_id='0123456789ab', reasons=reasons, method=method,
    )  # fmt: skip
