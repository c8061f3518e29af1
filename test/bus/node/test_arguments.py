"""A node's command line and the names that follow from it, as ROS 2 has them."""

from __future__ import annotations

import pytest

from tactile_nodes.bus.node.arguments import Names, parse_arguments, parse_remap
from tactile_nodes.errors import ConfigurationError


def _names(*rules: str, node: str = 'camera') -> Names:
    words = [word for rule in rules for word in ('-r', rule)]
    return Names.of(node, parse_arguments(['--ros-args', *words]))


def test_words_outside_of_ros_args_are_the_programs_own() -> None:
    found = parse_arguments(['a', '--ros-args', '-p', 'x:=1', '--', 'b'])
    assert found.rest == ('a', 'b')
    assert found.parameters[0].values['x'].value == 1


def test_parameter_of_one_node_is_kept_apart_from_those_of_all() -> None:
    found = parse_arguments(['--ros-args', '-p', 'camera:rate:=1.0', '-p', 'rate:=2.0'])
    assert [block.pattern for block in found.parameters] == ['camera', '/**']


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('/bags/a,b', '/bags/a,b'),
        ('pad[1]', 'pad[1]'),
        ('a}b', 'a}b'),
        ('[a, b]', ['a', 'b']),
        ('[1.0, 2.0]', [1.0, 2.0]),
        ("'[a, b]'", '[a, b]'),
        ('0x10', 16),
    ],
)
def test_value_of_p_is_read_alone_as_rcl_reads_it(text: str, value: object) -> None:
    (block,) = parse_arguments(['--ros-args', '-p', f'camera:folder:={text}']).parameters
    assert (block.pattern, {name: each.value for name, each in block.values.items()}) == ('camera', {'folder': value})


@pytest.mark.parametrize(('text', 'reason'), [('', 'has no value'), ('#1', 'has no value'), ('{a: 1}', 'hold a map')])
def test_value_of_p_that_a_parameter_cannot_hold_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^-p folder:=.*'folder' .*{reason}"):
        parse_arguments(['--ros-args', '-p', f'folder:={text}'])


def test_name_and_namespace_are_set_by_rules() -> None:
    names = _names('__node:=left', '__ns:=/skin/finger')
    assert (names.name, names.full_name) == ('left', '/skin/finger/left')


def test_rule_of_another_node_does_not_apply() -> None:
    assert _names('other:__node:=left').full_name == '/camera'


@pytest.mark.parametrize(
    ('name', 'full'),
    [('image', '/skin/image'), ('~/tare', '/skin/camera/tare'), ('/clock', '/clock'), ('a/b', '/skin/a/b')],
)
def test_names_are_expanded_by_their_first_character(name: str, full: str) -> None:
    assert _names('__ns:=/skin').resolve(name) == full


def test_first_remap_that_fits_wins_after_both_sides_are_expanded() -> None:
    names = _names('__ns:=/skin', '/skin/image:=/first', 'image:=second')
    assert names.resolve('image') == '/first'


def test_private_names_are_remapped() -> None:
    assert _names('~/tare:=/zero').resolve('~/tare') == '/zero'


@pytest.mark.parametrize('name', ['', '/', 'a//b', 'a/', '1a', 'a b', '~', 'ä', 'a.b'])
def test_name_that_ros_2_would_not_allow_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match='is not a valid name of a topic or service'):
        _names().resolve(name)


@pytest.mark.parametrize('rule', ['a', 'a=b', ':=b', 'a:='])
def test_remap_of_another_form_is_refused(rule: str) -> None:
    with pytest.raises(ConfigurationError, match='not of the form from:=to'):
        parse_remap(rule)


@pytest.mark.parametrize('name', ['1camera', 'a/b', 'a-b'])
def test_node_name_that_ros_2_would_not_allow_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match='is not a valid node name'):
        _names(f'__node:={name}')


@pytest.mark.parametrize(('text', 'level'), [('debug', 10), ('WARN', 30), ('camera:=error', 40)])
def test_log_level_is_read(text: str, level: int) -> None:
    assert parse_arguments(['--ros-args', '--log-level', text]).log_level == level


def test_log_level_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"'loud' is not one of debug, info"):
        parse_arguments(['--ros-args', '--log-level', 'loud'])
