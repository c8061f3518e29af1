"""Several nodes in one process, with messages passed between them without copies.

``composed_node camera flow_features force_estimator --ros-args …``; each node reads its own block of the files.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import NodeFactory, run_nodes
from tactile_nodes.errors import NOT_AGAIN, ConfigurationError, TactileError
from tactile_nodes.launching import packages

KNOWN = (
    'camera', 'flow_features', 'force_estimator', 'recorder', 'player', 'bridge', 'rig', 'emulated_rig', 'sync_input',
    'drift_monitor',
    'live_view',
    'force_views',
    'guarded_approach',
    'hand_sensors',
    'hand_wrench',
    'simulated_gripper',
    'guarded_grasp',
    'dds_bridge',
    'foxglove_bridge',
)  # fmt: skip


def node_class(name: str) -> type[Node]:
    """The class of the node ``<name>_node``.

    Raises:
        ConfigurationError: there is no such node.
    """
    short = name.removesuffix('_node')
    if short not in KNOWN:
        raise ConfigurationError(f'there is no node {name!r} to compose; available: {", ".join(KNOWN)}')
    module = importlib.import_module(packages.own_executables()[f'{short}_node'])
    found = [
        entry
        for entry in vars(module).values()
        if isinstance(entry, type) and issubclass(entry, Node) and entry.__module__ == module.__name__
    ]
    assert len(found) == 1, f'{module.__name__} must define one node'
    return found[0]


def run(argv: Sequence[str]) -> int:
    """Compose the nodes named on the command line. Returns the exit status."""
    try:
        names = parse_arguments(argv).rest
        if not names:
            raise ConfigurationError(f'name the nodes to compose; available: {", ".join(KNOWN)}')
        factories: list[NodeFactory] = [node_class(name) for name in names]
    except TactileError as error:
        sys.stderr.write(f'{error}\n')
        return NOT_AGAIN
    return run_nodes(factories, [word for word in argv if word not in names])


def main() -> int:
    """The program ``composed_node``."""
    return run(sys.argv[1:])


if __name__ == '__main__':
    sys.exit(main())
