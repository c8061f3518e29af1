"""A subscriber in another language, written from docs/bus.md, gets what a node publishes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.bus import topics
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.messages import types

PROGRAM = Path(__file__).parents[2] / 'examples/nodejs/subscribe.mjs'
DOMAIN = 19


@pytest.fixture
def node() -> str:
    if (found := shutil.which('node')) is None or not (PROGRAM.parent / 'node_modules').is_dir():
        pytest.skip('Node.js, or what npm install brings to examples/nodejs, is not there')
    return found


@pytest.fixture
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ZmqBus]:
    folder = tmp_path_factory.mktemp('r')
    folder.chmod(0o700)
    opened = ZmqBus(DOMAIN, folder=folder)
    yield opened
    opened.close()


def received_by(node: str, bus: ZmqBus, topic: Topic, message: object) -> list[dict[str, object]]:
    """The first two messages that the program prints of one that is published again and again."""
    publisher = bus.advertise(f'/{topic.name}', topic.type_name, topic.qos)
    folder = bus.meeting.folder.parent
    environment = {**os.environ, 'TACTILE_RUN_DIR': str(folder), 'ROS_DOMAIN_ID': str(DOMAIN)}
    program = subprocess.Popen(
        [node, str(PROGRAM), f'/{topic.name}', '2'], env=environment, stdout=subprocess.PIPE, text=True
    )
    done = threading.Event()

    def publish() -> None:
        while not done.wait(0.02):
            publisher.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        out, _ = program.communicate(timeout=60)
    finally:
        done.set()
        thread.join()
        program.kill()
    return [json.loads(line) for line in out.splitlines()]


def test_a_force_arrives_in_node_js_as_it_was_published(node: str, bus: ZmqBus) -> None:
    force = types.ForceDistribution(
        rows=1, cols=3, normal_force=np.array([0.5, 0.0, 1.25], np.float32), total=1.75, total_sigma=float('nan'),
        contacts=(types.Contact(force=1.75),),
    )  # fmt: skip
    first, second = received_by(node, bus, topics.FORCE_DISTRIBUTION, force)
    message = first['message']
    assert isinstance(message, dict)
    assert (message['rows'], message['cols'], message['total'], message['total_sigma']) == (1, 3, 1.75, None)
    assert message['normal_force'] == [0.5, 0.0, 1.25]
    assert message['contacts'][0]['force'] == 1.75
    assert int(str(second['number'])) == int(str(first['number'])) + 1


def test_a_large_message_of_two_frames_arrives_too(node: str, bus: ZmqBus) -> None:
    pixels = np.arange(440 * 440, dtype=np.uint32).astype(np.uint8)
    image = types.Image(height=440, width=440, encoding='mono8', step=440, data=pixels)
    message = received_by(node, bus, topics.IMAGE, image)[0]['message']
    assert isinstance(message, dict)
    assert message['data'][:3] + message['data'][-2:] == pixels[[0, 1, 2, -2, -1]].tolist()


def test_a_message_with_a_time_besides_that_of_its_header_arrives_too(node: str, bus: ZmqBus) -> None:
    state = types.CalibrationState(valid_from=types.Time(sec=7, nanosec=9))
    message = received_by(node, bus, topics.CALIBRATION_STATE, state)[0]['message']
    assert isinstance(message, dict)
    assert message['valid_from'] == {'sec': 7, 'nanosec': 9}


def test_a_process_that_ends_while_the_folder_is_read_does_not_end_the_program(node: str, bus: ZmqBus) -> None:
    (bus.meeting.folder / '0badcafe.json').symlink_to('removed')  # listed, and gone when it is read
    first, _ = received_by(node, bus, topics.FORCE_DISTRIBUTION, types.ForceDistribution(total=1.75))
    assert (bus.meeting.folder / '0badcafe.json').is_symlink()
    message = first['message']
    assert isinstance(message, dict)
    assert message['total'] == 1.75
