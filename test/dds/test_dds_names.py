"""Names, types and configuration of DDS."""

from __future__ import annotations

import doctest
import socket
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import pytest

from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.dds import names, settings
from tactile_nodes.dds.inward import Wish
from tactile_nodes.dds.settings import Discovery
from tactile_nodes.errors import ConfigurationError


def test_examples_in_the_names_hold() -> None:
    assert doctest.testmod(names).attempted == 4
    assert doctest.testmod(names).failed == 0


def test_nobody_listens_on_a_network_unasked() -> None:
    chosen = Discovery.chosen('', (), {})
    assert chosen.is_local
    config = ET.fromstring(chosen.config() or '')
    assert [peer.attrib['address'] for peer in config.iter('Peer')] == ['localhost']
    assert [entry.text for entry in config.iter('AllowMulticast')] == ['false']


def test_what_comes_by_loopback_is_heard_beside_the_interface_that_cyclone_chooses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settings, '_has_network', lambda: True)
    config = ET.fromstring(Discovery().config() or '')
    chosen, loopback = config.iter('NetworkInterface')
    assert chosen.attrib == {'autodetermine': 'true'}
    assert loopback.attrib == {'name': 'lo', 'multicast': 'false', 'priority': '-1'}


@pytest.mark.parametrize(
    ('states', 'has'),
    [
        ({'lo': 'up,loopback,running'}, False),
        ({'lo': 'up,loopback,running', 'eth0': 'broadcast'}, False),  # down
        ({'lo': 'up,loopback,running', 'tun0': 'up,pointopoint'}, False),  # no address
        ({'lo': 'up,loopback,running', 'docker0': 'up,broadcast'}, True),  # no cable, yet Cyclone prefers it
    ],
)
def test_a_machine_without_a_network_has_no_interface_twice(
    states: dict[str, str], has: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cyclone refuses: 'lo: the same interface may not be selected twice'."""
    stats = {name: SimpleNamespace(flags=flags) for name, flags in states.items()}
    address = SimpleNamespace(family=socket.AF_INET)
    monkeypatch.setattr(settings.psutil, 'net_if_stats', lambda: stats)
    monkeypatch.setattr(
        settings.psutil, 'net_if_addrs', lambda: {'lo': [address], 'eth0': [address], 'docker0': [address]}
    )
    assert ('NetworkInterface' in (Discovery().config() or '')) is has


@pytest.mark.parametrize(
    ('wish', 'value', 'local'),
    [('', 'SUBNET', False), ('', 'LOCALHOST', True), ('LOCALHOST', 'SUBNET', True), ('SUBNET', 'LOCALHOST', False)],
)
def test_ros_2s_own_variable_is_heeded_where_nothing_else_is_reported(wish: str, value: str, local: bool) -> None:
    assert Discovery.chosen(wish, (), {'ROS_AUTOMATIC_DISCOVERY_RANGE': value}).is_local is local


def test_on_a_network_the_configuration_of_cyclone_is_left_to_its_user() -> None:
    assert Discovery.chosen('SUBNET', (), {}).config() is None


def test_machines_that_are_named_are_asked_also_when_they_are_switched_on_later() -> None:
    """Cyclone asks for 30 s by itself."""
    config = ET.fromstring(Discovery.chosen('SUBNET', ('192.0.2.9',), {}).config() or '')
    assert [peer.attrib['address'] for peer in config.iter('Peer')] == ['localhost', '192.0.2.9']
    assert [entry.text for entry in config.iter('InitialLocatorPruneDelay')] == ['inf']


def test_a_machine_that_nobody_knows_is_refused_before_cyclone_sees_it() -> None:
    with pytest.raises(ConfigurationError, match=r"the peer 'robot\.invalid' cannot be resolved"):  # RFC 2606
        Discovery.chosen('SUBNET', ('robot.invalid',), {}).config()


@pytest.mark.parametrize(('wish', 'peers'), [('LOCALHOST', ('robot.local',)), ('MOON', ())])
def test_what_cannot_be_is_refused(wish: str, peers: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError):
        Discovery.chosen(wish, peers, {})


def test_a_value_of_the_variable_that_is_not_known_here_is_refused_by_its_name() -> None:
    with pytest.raises(ConfigurationError, match='ROS_AUTOMATIC_DISCOVERY_RANGE is SYSTEM_DEFAULT; choose LOCALHOST'):
        Discovery.chosen('', (), {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'system_default'})


def test_a_topic_of_the_table_needs_no_type() -> None:
    assert Wish.parse('/robot/wrench') == Wish('/robot/wrench', 'geometry_msgs/msg/WrenchStamped')


def test_each_type_of_the_table_can_be_sent() -> None:
    pytest.importorskip('cyclonedds', reason="Cyclone DDS is not installed: pip install 'tactile_nodes[dds]'")
    from tactile_nodes.dds.idl_types import idl_type

    for type_name in {topic.type_name for topic in TOPICS.values()}:
        made = idl_type(type_name)
        made.__idl__.fill_type_data()  # what creating a topic does
        assert made.__idl__.idl_transformed_typename == names.dds_type(type_name)
