"""Check 5: our type hashes are those that rosidl generated.

Expected: `type_hashes` in share/<package>/msg/<Name>.json of our package and of ROS 2's equals
`tactile_nodes.messages.type_hash` for every type that the package sends.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ros2_here import ROOT, needs_ros

from tactile_nodes import messages
from tactile_nodes.bus.topics import TOPICS

OWN = {f'tactile_nodes/msg/{file.stem}' for file in (ROOT / 'msg').glob('*.msg')}
TYPES = sorted(OWN | {topic.type_name for topic in TOPICS.values()})

pytestmark = [needs_ros, pytest.mark.timeout(900)]


@pytest.mark.parametrize('type_name', TYPES)
def test_hash_is_the_generated_one(installed: dict[str, str], type_name: str) -> None:
    package, kind, name = type_name.split('/')
    prefixes = [Path(prefix) for prefix in installed['AMENT_PREFIX_PATH'].split(':')]
    found = [prefix / 'share' / package / kind / f'{name}.json' for prefix in prefixes]
    file = next(file for file in found if file.is_file())
    hashes = {entry['type_name']: entry['hash_string'] for entry in json.loads(file.read_text())['type_hashes']}
    assert messages.type_hash(type_name) == hashes[type_name]
