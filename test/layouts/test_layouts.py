"""The layouts for RViz and Foxglove show topics that there are, of types that their displays draw."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import yaml

from tactile_nodes import messages
from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.nodes.force_views import ForceViewsParams
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors import Mounting

DRAWS = {
    'PointCloud2': 'sensor_msgs/msg/PointCloud2',
    'MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'PointStamped': 'geometry_msgs/msg/PointStamped',
    'Wrench': 'geometry_msgs/msg/WrenchStamped',
    'Image': 'sensor_msgs/msg/Image',
}
"""RViz 2's displays and what they subscribe (rviz_default_plugins/plugins_description.xml)."""


def rviz() -> dict[str, Any]:
    made: dict[str, Any] = yaml.safe_load((share_directory() / 'config/rviz/tactile.rviz').read_text(encoding='utf-8'))
    return made['Visualization Manager']


def foxglove() -> dict[str, Any]:
    made: dict[str, Any] = json.loads((share_directory() / 'config/foxglove/tactile.json').read_text(encoding='utf-8'))
    return made


def panels(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels(layout['first'])
        yield from panels(layout['second'])


def topic_type(name: str) -> str:
    found = TOPICS.get(name) or TOPICS[name.removeprefix('/')]
    return found.type_name


def test_rviz_subscribes_topics_of_the_table_by_displays_that_draw_their_type() -> None:
    shown = {each['Topic']['Value']: each['Class'].split('/')[1] for each in rviz()['Displays'] if 'Topic' in each}
    assert len(shown) == 6
    assert {name: DRAWS[display] for name, display in shown.items()} == {name: topic_type(name) for name in shown}


def test_rviz_stands_in_the_frame_that_the_static_transform_tells() -> None:
    mounting = Mounting()
    assert ForceViewsParams().parent_frame_id == mounting.parent
    assert rviz()['Global Options']['Fixed Frame'] == mounting.parent
    assert [each['Reference Frame'] for each in rviz()['Displays'] if 'Reference Frame' in each] == [mounting.id]
    assert foxglove()['configById']['3D!gel']['followTf'] == mounting.parent


def test_foxglove_lays_out_each_panel_that_it_configures_once() -> None:
    layout = foxglove()
    assert sorted(panels(layout['layout'])) == sorted(layout['configById'])


def test_foxglove_draws_pictures_from_image_topics() -> None:
    names = [
        config['imageMode']['imageTopic']
        for panel, config in foxglove()['configById'].items()
        if panel.startswith('Image!')
    ]
    assert {topic_type(name) for name in names} == {'sensor_msgs/msg/Image'}
    assert len(names) == 3


def test_foxglove_names_no_topic_and_no_field_that_there_is_not() -> None:
    text = json.dumps(foxglove())
    named = set(re.findall(r'"(/[^"]*)"', text))
    assert len(named) > 8
    for path in named:
        topic, *fields = path.split('.')
        message: Any = messages.message_class(topic_type(topic))()
        for field in fields:
            message = getattr(message, field)
