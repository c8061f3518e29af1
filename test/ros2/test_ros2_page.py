"""What docs/ros2.md and package.xml say of the package is so."""

from __future__ import annotations

import re

from ros2_here import ROOT

from tactile_nodes.bus.topics import ROSOUT, TOPICS
from tactile_nodes.messages.services import SERVICES

PAGE = (ROOT / 'docs/ros2.md').read_text(encoding='utf-8')


# Jazzy's message classes are compiled against numpy 1.26; OpenCV 4.12 asks for numpy 2.
NARROWER = {
    'numpy>=1.26,<3': 'numpy>=1.26,<2',
    'opencv-contrib-python-headless>=4.10,<6': 'opencv-contrib-python-headless>=4.10,<4.12',
}


def test_command_for_pip_installs_what_the_package_requires() -> None:
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    block = re.search(r'install_requires=\[(.*?)\]', setup, re.DOTALL)
    command = re.search(r'\$ pip install (.*?)\n\$ colcon', PAGE, re.DOTALL)
    assert block is not None
    assert command is not None
    required = [NARROWER.get(entry, entry) for entry in re.findall(r"'([^']+)'", block.group(1))]
    assert re.findall(r"'([^']+)'", command.group(1)) == required


def test_every_test_of_the_folder_is_in_the_table() -> None:
    here = {file.name for file in (ROOT / 'test/ros2').glob('test_*.py')} - {'test_ros2_page.py'}
    assert set(re.findall(r'`(test_\w+\.py)`', PAGE)) == here


def test_package_names_every_package_whose_types_are_sent() -> None:
    text = (ROOT / 'package.xml').read_text(encoding='utf-8')
    sent = {name.split('/')[0] for name in [*SERVICES, *(topic.type_name for topic in TOPICS.values())]}
    assert sent - {'tactile_nodes'} <= set(re.findall(r'<depend>(\w+)</depend>', text))


def test_messages_use_only_packages_that_the_build_looks_for() -> None:
    cmake = (ROOT / 'CMakeLists.txt').read_text(encoding='utf-8')
    found = re.search(r'set\(message_dependencies (.*?)\)', cmake)
    assert found is not None
    used = {
        match.group(1)
        for file in (ROOT / 'msg').glob('*.msg')
        for match in re.finditer(r'^([a-z_]+)/', file.read_text(encoding='utf-8'), re.MULTILINE)
    }
    assert used == set(found.group(1).split())


def test_quality_of_service_in_the_table_is_that_of_the_topics() -> None:
    rows = re.findall(r'^\| ((?:`[^`]+`(?:, )?)+) \| reliable \| ([^|]+) \| (\d+) \|', PAGE, re.MULTILINE)
    assert len(rows) >= 6
    for names, durability, depth in rows:
        for name in re.findall(r'`([^`]+)`', names):
            qos = TOPICS[name].qos
            assert qos.depth == int(depth), name
            latched = qos.latched or name == ROSOUT.name  # bus/ros2/qos.py
            assert durability.startswith('transient local' if latched else 'volatile'), name
