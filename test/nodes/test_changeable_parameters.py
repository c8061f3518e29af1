"""What a running node would not heed it refuses to have set, instead of saying that it was."""

from __future__ import annotations

import pytest

from reference.nodes import NodeKind, node_kinds
from tactile_nodes import params

ANY_TIME = {
    'camera': set(),
    'flow_features': {'reference_file', 'overlay_folder', 'overlay_every'},
    'rig': set(),
    'guarded_approach': set(),
    'sync_input': set(),
    'player': {'rate'},
    'calibrator': {'stay'},
    'drift_monitor': {'check_s', 'weight_g'},
}
"""The parameters that these nodes look at again whenever they need them, or take over in `on_parameters`."""


@pytest.mark.parametrize(
    'node', [node for node in node_kinds() if node.module in ANY_TIME], ids=lambda node: node.module
)
def test_a_node_takes_while_it_runs_what_it_will_heed_and_nothing_else(node: NodeKind) -> None:
    found = {entry.name for entry in params.describe(node.kind.PARAMS) if not entry.read_only}
    assert found == ANY_TIME[node.module]


def test_of_an_emulated_rig_its_faults_are_what_can_be_set() -> None:
    (rig,) = (node for node in node_kinds() if node.module == 'emulated_rig')
    changeable = [entry.name for entry in params.describe(rig.kind.PARAMS) if not entry.read_only]
    assert changeable
    assert all(name.startswith('faults.') for name in changeable)
