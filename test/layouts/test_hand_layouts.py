"""URDF and layouts of the hand that ships stand in its frames, and show topics that its launch has."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from typing import Any

import pytest
import yaml

from tactile_nodes import messages
from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors import load_hand

HAND = load_hand('two_fingers')
CONFIG = share_directory() / 'config'


def topic_type(name: str) -> str:
    """Of a topic of the hand, or of one of its sensors."""
    sensor, _, rest = name.removeprefix('/').partition('/')
    return TOPICS[rest if sensor in HAND.names else name.removeprefix('/')].type_name


def test_the_urdf_has_the_sensors_where_the_hand_has_them() -> None:
    joints = ET.parse(CONFIG / 'hands/two_fingers.urdf').getroot().findall('joint')
    expected = {
        joint.find('child').get('link'): (
            joint.find('parent').get('link'),
            *(pytest.approx([float(each) for each in joint.find('origin').get(key).split()]) for key in ('xyz', 'rpy')),
        )
        for joint in joints
    }
    frames = [sensor.frame for sensor in HAND.sensors]
    assert {frame.id: (frame.parent, list(frame.xyz_m), list(frame.rpy_rad)) for frame in frames} == expected


def test_rviz_shows_both_fingers_in_the_frame_of_the_hand() -> None:
    layout = yaml.safe_load((CONFIG / 'rviz/two_fingers.rviz').read_text('utf-8'))['Visualization Manager']
    assert layout['Global Options']['Fixed Frame'] == HAND.frame
    shown = [each['Topic']['Value'] for each in layout['Displays'] if 'Topic' in each]
    assert {name.split('/')[1] for name in shown} == set(HAND.names)
    assert {each['Class'].split('/')[1]: topic_type(each['Topic']['Value']).split('/')[2] for each in layout['Displays']
            if 'Topic' in each} == {kind: kind for kind in ('PointCloud2', 'MarkerArray', 'Image')}  # fmt: skip


def test_foxglove_names_no_topic_and_no_field_that_there_is_not() -> None:
    layout = json.loads((CONFIG / 'foxglove/two_fingers.json').read_text('utf-8'))
    assert layout['configById']['3D!hand']['followTf'] == HAND.frame
    named = set(re.findall(r'"(/[^"]*)"', json.dumps(layout)))
    assert len(named) > 8
    for path in named:
        topic, *fields = path.split('.')
        found: Any = messages.message_class(topic_type(topic))()
        for field in fields:
            name, _, place = field.partition('[')
            found = getattr(found, name)
            if place:
                found = messages.message_class('tactile_nodes/msg/GraspMargin')()
    panels = set(re.findall(r'"(\w+!\w+)"', json.dumps(layout['layout'])))
    assert panels == set(layout['configById'])
