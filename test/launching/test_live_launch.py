"""The main job, as a user starts it: processes, a bus, force."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from launch_processes import numpy_only, processes_of, still_there

from tactile_nodes import messages, paths
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import monotonic_s
from tactile_nodes.messages import types
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.sensing.geometry import BinGrid

DOMAIN = 71
PATIENCE_S = 60.0
ALONE = 'page:=false', 'monitor:=false', 'compiled:=false'
"""What fails without page, drift monitor and compiled loops fails with them."""
COMPUTED = 'model:=fast', 'compiled:=false'


@contextmanager
def launched(*arguments: str, log: Path) -> Iterator[subprocess.Popen[str]]:
    """`tactile launch` in a domain of its own; ended by SIGINT, and killed only if that did not do."""
    command = [sys.executable, '-m', 'tactile_nodes', 'launch', *arguments]
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_LOG_DIR': str(log)}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


@pytest.fixture
def bus() -> Iterator[ZmqBus]:
    made = ZmqBus(DOMAIN)
    yield made
    made.close()


def subscribe(bus: ZmqBus, topic: Topic) -> Subscription:
    return bus.subscribe('/' + topic.name.lstrip('/'), topic.type_name, Qos('queue', 1000))


def first(subscription: Subscription) -> Received:
    received = subscription.get(PATIENCE_S)
    assert received is not None, f'nothing on {subscription.topic}'
    return received


def centre_mm(force: types.ForceDistribution) -> tuple[float, float]:
    """Of all that touches: where two balls press alike, chance says which of them is the strongest."""
    on_bins = np.asarray(force.normal_force, float).reshape(force.rows, force.cols)
    x, y = np.einsum('yx,yxc->c', on_bins, BinGrid(force.rows, force.cols).centres_mm) / on_bins.sum()
    return float(x), float(y)


def test_live_launch_senses_the_press_of_the_simulated_probe(bus: ZmqBus, tmp_path: Path) -> None:
    """At a third of its rate, since the camera draws every picture."""
    forces, truths = subscribe(bus, topics.FORCE_DISTRIBUTION), subscribe(bus, topics.TRUE_FORCE)
    with launched('live', 'fps:=20', log=tmp_path) as process:
        truth_by_stamp: dict[int, types.ForceDistribution] = {}
        pressed: list[tuple[types.ForceDistribution, types.ForceDistribution]] = []
        deadline_s = monotonic_s() + PATIENCE_S
        while len(pressed) < 10 and monotonic_s() < deadline_s:
            force = first(forces).message
            while (received := truths.take()) is not None:
                truth_by_stamp[messages.stamp_ns(received.message.header.stamp)] = received.message
            truth = truth_by_stamp.get(messages.stamp_ns(force.header.stamp))
            # A machine that others keep busy is late, and says so: such a force is stale, but right.
            late_or_ok = not force.reasons & ~types.ForceDistribution.REASON_STALE
            if truth is not None and truth.total > 0.3 and late_or_ok:
                pressed.append((force, truth))
        assert len(pressed) >= 10
        for force, truth in pressed:
            assert force.provenance.model == 'field'
            # The bounds are wide: that it follows at all is tested here, how well is in docs/results/contacts.md.
            assert abs(force.total - truth.total) < 0.05 + 0.1 * truth.total
            assert math.dist(centre_mm(force), centre_mm(truth)) < 1.0
        children = processes_of(process.pid)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
        assert not still_there(children)


def test_a_camera_that_is_not_there_is_one_sentence_at_the_end_and_a_failure(tmp_path: Path) -> None:
    with launched('live', 'source:=/dev/video99', *ALONE, log=tmp_path) as process:
        output, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode != 0
        assert '/dev/video99' in output.splitlines()[-1]
        assert 'Traceback' not in output


def test_a_replay_computes_as_live_sensing_does() -> None:
    defaults = set()
    for name in ('live', 'replay'):
        arguments = {each['arg']['name']: each['arg'] for each in entries(name) if 'arg' in each}
        defaults.add((arguments['model']['default'], arguments['compiled']['default']))
    assert defaults == {('field', 'auto')}


def test_a_replay_of_one_finger_can_skip_the_pictures_that_the_hand_skipped() -> None:
    """Set for all nodes: a node's own parameter would override the file with which `replay_hand` starts this launch."""
    for_all = [each['set_parameter'] for each in entries('replay') if 'set_parameter' in each]
    assert {'name': 'most_hz', 'value': '$(eval "1.0 * $(var most_hz)")'} in for_all


def test_replays_record_nothing_before_their_first_picture() -> None:
    """Else one that fails before would leave a bag."""
    begins = {
        name: [each['value'] for node in entries(name) if 'node' in node and node['node']['exec'] == 'recorder_node'
               for each in node['node']['param'] if each['name'] == 'begins_with']
        for name in ('replay', 'replay_hand')
    }  # fmt: skip
    assert begins == {'replay': ['image_raw'], 'replay_hand': ['*/image_raw']}


def entries(launch: str) -> list[dict[str, Any]]:
    """Of a launch file and its groups."""
    document = yaml.safe_load((paths.share_directory() / 'launch' / f'{launch}.launch.yaml').read_text())
    return [each for entry in document['launch'] for each in entry.get('group', [entry])]


def test_a_replay_that_fails_before_its_first_picture_leaves_no_bag(tmp_path: Path) -> None:
    made, hand = tmp_path / 'replayed', tmp_path / 'hand.yaml'
    hand.write_text(f'sensors: [{{name: left, model: fast, config: {numpy_only(tmp_path)}}}]\n')
    with launched('replay_hand', f'hand:={hand}', 'bag:=nosuch', f'record:={made}', log=tmp_path / 'log') as process:
        output, _ = process.communicate(timeout=2 * PATIENCE_S)
    assert process.returncode == 1
    assert 'there is no bag nosuch' in output.splitlines()[-1]
    assert not made.exists()


def computed_one_after_another(bag: Path) -> Iterator[types.ForceDistribution]:
    """The force of each picture of a bag, found before the next one comes."""
    parameters = [word for each in COMPUTED for word in ('-p', each)]
    file = str(paths.share_directory() / 'config/live.yaml')
    arguments = parse_arguments(['--ros-args', '--params-file', file, '-p', 'reference:=topic', *parameters])
    bus = InProcessBus()
    nodes = [kind(bus, arguments) for kind in (FlowFeaturesNode, ForceEstimatorNode)]
    forces = bus.subscribe('/force_distribution', topics.FORCE_DISTRIBUTION.type_name, Qos('queue', 1))
    made = [topics.REFERENCE_IMAGE, topics.CALIBRATION_STATE, topics.IMAGE]
    publishers = {f'/{topic.name}': bus.advertise(f'/{topic.name}', topic.type_name, topic.qos) for topic in made}
    with BagReader(bag) as played:
        for message in played.messages(publishers):
            publishers[message.topic].publish_bytes(message.data)
            for node in nodes:
                while node._work.qsize():
                    node.spin_once()
            if (force := forces.take()) is not None:
                yield force.message
    for node in nodes:
        node.close()
    bus.close()


def test_a_replay_too_fast_for_the_machine_leaves_nothing_out_and_changes_no_bit(tmp_path: Path) -> None:
    """25 pictures of 4 s come within a twentieth of that, far faster than their forces can be found."""
    bag, made = Path(__file__).parents[2] / 'examples/press_bag', tmp_path / 'replayed'
    words = *COMPUTED, f'bag:={bag}', f'record:={made}', 'rate:=100.0'
    with launched('replay', *words, log=tmp_path) as process:
        output, _ = process.communicate(timeout=2 * PATIENCE_S)
        assert process.returncode == 0, output
    with BagReader(made) as replayed:
        found = [replayed.decode(message) for message in replayed.messages(['/force_distribution'])]
    expected = list(computed_one_after_another(bag))
    assert len(found) == len(expected) == 25
    for one, other in zip(found, expected, strict=True):
        assert messages.encode(dataclasses.replace(one, stages=other.stages)) == messages.encode(other)
