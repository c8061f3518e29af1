"""Live sensing on the ROS 2 bus: the nodes in this process with the emulator, and launched by ROS 2 where it is."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from typing import Any

import pytest
from ros2_here import ROOT, needs_ros, run

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.nodes.camera import CameraNode
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

LAUNCH = ['ros2', 'launch', '-n', 'tactile_nodes', 'live.launch.yaml', 'page:=false']

Join = Callable[[], Any]
Until = Callable[[Callable[[], Any]], Any]


@pytest.mark.timeout(180)
def test_force_of_a_simulated_gel_comes_out_of_the_graph(join: Join, spinning: Callable[[Node], Node]) -> None:
    arguments = parse_arguments(['--ros-args', '-r', '__ns:=/skin', '--params-file', str(ROOT / 'config/live.yaml')])
    robot = join()
    topic = topics.FORCE_DISTRIBUTION
    forces = robot.subscribe(f'/skin/{topic.name}', topic.type_name, Qos('queue', 1000))
    for kind in (ForceEstimatorNode, FlowFeaturesNode, CameraNode):
        spinning(kind(join(), arguments))
    received = forces.get(90.0)
    assert received is not None
    assert received.message.provenance.model
    assert received.message.normal_force.shape == (received.message.rows * received.message.cols,)
    assert 0 < received.message.header.stamp.sec <= robot.clock.now_ns() // 10**9


@needs_ros
@pytest.mark.timeout(900)
def test_launched_by_ros_2_it_answers_the_tools_of_ros_2_and_ends_within_five_seconds(
    installed: dict[str, str], running: Callable[..., Any], until: Until
) -> None:
    launch = running(*LAUNCH)
    for more in (['--no-daemon'], []):  # the daemon, which the tools below ask, begins with the first of these
        until(lambda more=more: '/force_distribution' in run(['ros2', 'topic', 'list', *more], installed))
    said = run(['ros2', 'topic', 'echo', '--once', '/force_distribution', '--field', 'status'], installed)
    assert said.split()[0] in {'0', '1', '2'}
    run(['ros2', 'topic', 'echo', '--once', '/wrench'], installed)
    run(['ros2', 'topic', 'echo', '--once', '/diagnostics'], installed)
    assert '/camera' in run(['ros2', 'node', 'list'], installed).split()
    assert 'use_sim_time' in run(['ros2', 'param', 'list', '/camera'], installed)
    assert 'Boolean value is: False' in run(['ros2', 'param', 'get', '/camera', 'use_sim_time'], installed)
    capture = ['ros2', 'service', 'call', '/flow_features/capture_reference', 'std_srvs/srv/Trigger']
    assert 'success' in run(capture, installed)
    begin_s = time.monotonic()
    launch.send_signal(signal.SIGINT)
    launch.wait(20.0)
    assert time.monotonic() - begin_s < 5.0


@needs_ros
@pytest.mark.timeout(900)
def test_images_of_a_best_effort_camera_of_others_are_taken(
    installed: dict[str, str], running: Callable[..., Any], until: Until, join: Join
) -> None:
    """`usb_cam` and `v4l2_camera` can be set to publish as best effort: then a parameter makes it match."""
    override = 'qos_overrides./image_raw.subscription.reliability:=best_effort'
    running('ros2', 'run', 'tactile_nodes', 'flow_features_node', '--ros-args', '-p', override)
    publisher = join().advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1, reliable=False))
    until(lambda: publisher.listeners)
    said = run(['ros2', 'param', 'dump', '/flow_features'], installed)
    assert 'best_effort' in json.dumps(said)
