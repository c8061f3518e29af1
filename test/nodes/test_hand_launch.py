"""A hand as a user starts it: one launch, two sensors in their namespaces, one sum; and one that cannot start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import monotonic_s

DOMAIN = 73
PATIENCE_S = 60.0


@pytest.fixture
def bus() -> Iterator[ZmqBus]:
    made = ZmqBus(DOMAIN)
    yield made
    made.close()


def subscribe(bus: ZmqBus, topic: Topic, below: str = '') -> Subscription:
    return bus.subscribe(f'{below}/{topic.name.lstrip("/")}', topic.type_name, Qos('queue', 1000))


def launched(hand: Path, log: Path) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        '-m',
        'tactile_nodes',
        'launch',
        'hand',
        f'hand:={hand}',
        'monitor:=false',
        'page:=false',
    ]
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_LOG_DIR': str(log)}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_a_hand_senses_with_the_sensors_that_can_start_and_ends_with_all_of_them(bus: ZmqBus, tmp_path: Path) -> None:
    hand = tmp_path / 'hand.yaml'
    hand.write_text(
        'frame: grip\nfps: 20.0\nsensors:\n'
        '  - {name: left, contact: tip, model: fast, frame: {position_mm: [0.0, 30.0, 80.0]}}\n'
        '  - {name: right, contact: tip, model: fast}\n'
        '  - {name: gone, source: /dev/video99}\n'
        '  - {name: right, contact: ring}\n'
    )
    forces = [subscribe(bus, topics.FORCE_DISTRIBUTION, f'/{name}') for name in ('left', 'right')]
    sums, told = subscribe(bus, topics.HAND_WRENCH), subscribe(bus, topics.DIAGNOSTICS)
    process = launched(hand, tmp_path)
    try:
        received = [each.get(PATIENCE_S) for each in forces]
        assert [each.message.header.frame_id for each in received if each is not None] == ['left', 'right']
        made = sums.get(PATIENCE_S)
        assert made is not None
        assert made.message.header.frame_id == 'grip'
        assert 'gone' in made.message.missing
        wanted, deadline_s = {'/dev/video99', "two sensors with the name 'right'"}, monotonic_s() + PATIENCE_S
        while wanted and monotonic_s() < deadline_s:
            heard = told.get(PATIENCE_S)
            texts = ' '.join(status.message for status in heard.message.status) if heard is not None else ''
            wanted = {each for each in wanted if each not in texts}
        assert not wanted
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) > 6  # two programs and their guardian; two of each sensor
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert 'Traceback' not in output
    assert not [child for child in children if child.is_running() and child.status() != psutil.STATUS_ZOMBIE]


def test_a_hand_that_is_none_is_one_sentence_and_a_failure(tmp_path: Path) -> None:
    (tmp_path / 'hand.yaml').write_text('sensors: [{soruce: simulated}]\n')
    output, _ = (process := launched(tmp_path / 'hand.yaml', tmp_path)).communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "unknown parameter 'soruce'" in output.splitlines()[-1]
    assert 'Traceback' not in output
