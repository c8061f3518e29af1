"""Several nodes in one process, with messages passed between them without copies.

``composed_node camera flow_features force_estimator --ros-args …``; each node reads its own block of the files.
In a source tree that is not installed, ``python -m tactile_nodes.nodes.composed camera`` also starts a single node.
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

MODULES = {
    executable.removesuffix('_node'): module
    for executable, module in packages.own_executables().items()
    if module != 'tactile_nodes.nodes.composed'
}


def node_class(name: str) -> type[Node]:
    """The class of the node ``<name>_node``.

    Raises:
        ConfigurationError: there is no such node.
    """
    short = name.removesuffix('_node')
    if short not in MODULES:
        raise ConfigurationError(f'there is no node {name!r} to compose; available: {", ".join(MODULES)}')
    module = importlib.import_module(MODULES[short])
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
            raise ConfigurationError(f'name the nodes to compose; available: {", ".join(MODULES)}')
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
