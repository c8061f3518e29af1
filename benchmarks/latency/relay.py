"""Time of the transport alone: ``tactile launch live`` with relays instead of its nodes for motion and force.

The relays compute nothing: for each picture they publish a recorded message. Processes, topics and sizes of messages
are the same, so the times are the minimum for the transport on this machine.
"""

from __future__ import annotations

import os
import sys
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.harness.workers import environment
from tactile_nodes import conversions, paths
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_nodes
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import Clock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import decode, encode
from tactile_nodes.nodes.flow_features import FlowFeaturesParams
from tactile_nodes.nodes.force_estimator import ForceEstimatorParams

PACKAGE, PROGRAM, FOLDER = 'tactile_relay', 'relay_node', 'TACTILE_RELAY'
REPLACED = 'pkg: tactile_nodes\n          exec: composed_node'
RELAYED = topics.FLOW_FEATURES, topics.FORCE_DISTRIBUTION


class RelayedMotion(Node):
    """Publishes the recorded features for each picture."""

    NAME = 'flow_features'
    PARAMS = FlowFeaturesParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._message = kept(topics.FLOW_FEATURES)
        self._features = self.create_publisher(topics.FLOW_FEATURES)
        self.create_subscription(topics.IMAGE, self._on_image)

    def _on_image(self, received: Received) -> None:
        self._features.publish(replace(self._message, header=received.message.header))


class RelayedForce(Node):
    """Publishes the recorded force for all features."""

    NAME = 'force_estimator'
    PARAMS = ForceEstimatorParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._message = kept(topics.FORCE_DISTRIBUTION)
        self._force = self.create_publisher(topics.FORCE_DISTRIBUTION)
        self._wrench = self.create_publisher(topics.WRENCH)
        self.create_subscription(topics.FLOW_FEATURES, self._on_features)

    def _on_features(self, received: Received) -> None:
        force = replace(self._message, header=received.message.header)
        self._force.publish(force)
        if self._wrench.listeners:
            self._wrench.publish(conversions.wrench_message(force))


def keep(folder: Path, topic: Topic, message: Any) -> None:
    """Store a message of a topic for a relay."""
    (folder / topic.name).write_bytes(encode(message))


def kept(topic: Topic) -> Any:
    """The message stored by `keep`."""
    return decode((Path(os.environ[FOLDER]) / topic.name).read_bytes(), topic.type_name)


def relayed(folder: Path) -> Path:
    """Write a launch file like that of live sensing, but with the relay from a separate package, both in `folder`.

    Raises:
        ConfigurationError: the launch file does not start the process to replace.
    """
    text = (paths.share_directory() / 'launch' / 'live.launch.yaml').read_text(encoding='utf-8')
    if REPLACED not in text:
        raise ConfigurationError('live.launch.yaml starts no composed_node, so a relay cannot take its place')
    marker = folder / 'share/ament_index/resource_index/packages' / PACKAGE
    program, file = folder / 'lib' / PACKAGE / PROGRAM, folder / 'relayed.launch.yaml'
    for each in (marker, program):
        each.parent.mkdir(parents=True, exist_ok=True)
    marker.touch()
    begin = 'import sys; from benchmarks.latency.relay import main; sys.exit(main())'
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{begin}" "$@"\n', encoding='utf-8')
    program.chmod(0o755)
    file.write_text(text.replace(REPLACED, f'pkg: {PACKAGE}\n          exec: {PROGRAM}'), encoding='utf-8')
    return file


def relaying(folder: Path) -> AbstractContextManager[None]:
    """The environment in which the launch finds its relay."""
    root = str(Path(__file__).resolve().parents[2])
    return environment(AMENT_PREFIX_PATH=str(folder), PYTHONPATH=root, **{FOLDER: str(folder)})


def main() -> int:
    """The program that replaces ``composed_node force_estimator flow_features``."""
    words = [word for word in sys.argv[1:] if word not in {RelayedForce.NAME, RelayedMotion.NAME}]
    return run_nodes([RelayedForce, RelayedMotion], words)
