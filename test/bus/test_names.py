"""Names that are allowed in ROS 2: design.ros2.org (topic and service names), rmw/validate_full_topic_name.h."""

from __future__ import annotations

import pytest

from tactile_nodes.bus.names import LONGEST, absolute, absolute_namespace
from tactile_nodes.errors import ConfigurationError

NO_NAMES = ['', '/', '//a', 'a//b', 'a/', '/a/', '1a', 'a/1b', 'a b', '~', '~/a', 'ä', 'a.b', 'a-b', 'a\n', '{node}']


@pytest.mark.parametrize('name', NO_NAMES)
def test_what_ros_2_would_not_allow_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match='is not a valid name of a topic or service'):
        absolute(name)


@pytest.mark.parametrize('name', ['_hidden', 'a1', 'a__b', '/skin/left_2/force'])
def test_what_it_allows_is_not(name: str) -> None:
    assert absolute(name) == '/' + name.removeprefix('/')


def test_a_full_name_may_be_as_long_as_dds_takes_and_no_longer() -> None:
    assert len(absolute('a' * (LONGEST - 1))) == LONGEST
    with pytest.raises(ConfigurationError, match='more than 247 characters'):
        absolute('a' * LONGEST)


def test_the_root_is_a_namespace() -> None:
    assert absolute_namespace('') == absolute_namespace('/') == '/'
    assert absolute_namespace('skin/') == '/skin'


@pytest.mark.parametrize('name', ['a b', '1', 'skin-left'])
def test_a_namespace_that_ros_2_would_not_allow_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match='is not a valid name of a namespace'):
        absolute_namespace(name)
