"""What a running node would not heed it refuses to have set, instead of saying that it was."""

from __future__ import annotations

from pathlib import Path

import pytest
from feeding import PATTERN, given, image, run

from reference.nodes import NodeKind, node_kinds
from tactile_nodes import params
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.clock import SteppedClock
from tactile_nodes.nodes.flow_features import FlowFeaturesNode

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


def test_a_folder_for_drawings_that_cannot_be_read_is_a_sentence_and_not_the_end_of_the_node(
    bus: InProcessBus, clock: SteppedClock, small_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the one of another user; nothing would be measured any more, also not after a restart, which keeps it set."""

    def forbidden(folder: Path, pattern: str) -> list[Path]:
        raise PermissionError(13, 'Permission denied', str(folder))

    node = FlowFeaturesNode(bus, given(f'model:={small_model}', 'reference_frames:=1'), clock)
    node._parameters.change({'overlay_folder': '/home/other/drawn', 'overlay_every': 1})
    monkeypatch.setattr(Path, 'glob', forbidden)
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
    for _ in range(2):  # the first becomes the rest image
        camera.publish(image(PATTERN))
        run(node)
    told = {status.name: status.message for status in node.diagnostics.message(0).status}
    assert told['flow_features: errors'] == 'cannot read /home/other/drawn (Permission denied); choose another folder'
