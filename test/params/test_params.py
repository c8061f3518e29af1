"""Parameter files by rcl's rules: the expectations are those seen on ROS 2 Jazzy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import (
    describe,
    exact_names,
    from_mapping,
    load_parameter_file,
    parameter,
    parse_parameters,
    parse_scalar,
    resolve_parameters,
    to_values,
)


@dataclass(frozen=True)
class Inner:
    gain: float = parameter(1.0, 'a gain', minimum=0.0)


@dataclass(frozen=True)
class Block:
    rate: float = parameter(60.0, 'frames per second', minimum=1.0, maximum=240.0)
    preset: str = parameter('medium', 'which preset', choices=('fast', 'medium'))
    threads: int = parameter(1, 'threads', read_only=True)
    crop: tuple[int, ...] = parameter((440, 440), 'crop')
    offset: float = parameter(0.0, 'a length without bounds')
    inner: Inner = Inner()


@dataclass(frozen=True)
class Switch:
    READ_ONLY: ClassVar[bool] = False

    on: bool = parameter(False, 'on')


@dataclass(frozen=True)
class Machine:
    READ_ONLY: ClassVar[bool] = True

    port: str = parameter('', 'where it is')
    label: str = parameter('', 'what it is called', read_only=False)
    inner: Inner = Inner()
    switch: Switch = Switch()


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('00012345', 5349),
        ('0x10', 16),
        ('-7', -7),
        ('1e5', 1e5),
        ('1e-3', 1e-3),
        ('5.', 5.0),
        ('on', True),
        ('N', False),
        ('089', 89.0),  # no octal number, so strtoll stops and strtod takes it
        ('.inf', math.inf),
        ('-.inf', -math.inf),
        ('1.2.3', '1.2.3'),
        ('null', 'null'),
        ('9223372036854775808', 9223372036854775808.0),
    ],
)
def test_unquoted_scalars_are_typed_as_rcl_types_them(text: str, value: object) -> None:
    assert parse_scalar(text) == value
    assert type(parse_scalar(text)) is type(value)


def test_quoted_and_tagged_scalars_stay_strings() -> None:
    blocks = parse_parameters('/a: {ros__parameters: {p: "5", q: !!str 5, r: \'true\'}}', 'f')
    assert {name: located.value for name, located in blocks[0].values.items()} == {'p': '5', 'q': '5', 'r': 'true'}


def _value(text: str, node: str, name: str = 'p') -> object:
    return resolve_parameters(node, parse_parameters(text, 'f'))[name].value


def test_later_specific_block_beats_earlier_wildcard() -> None:
    text = '/**: {ros__parameters: {p: 1}}\n/skin/demo1: {ros__parameters: {p: 2}}'
    assert _value(text, '/skin/demo1') == 2


def test_wildcard_that_appears_later_beats_specific_block() -> None:
    text = '/skin/demo1: {ros__parameters: {p: 2}}\n/**: {ros__parameters: {p: 1}}'
    assert _value(text, '/skin/demo1') == 1


def test_pattern_keeps_the_place_of_its_first_appearance() -> None:
    blocks = parse_parameters('/**: {ros__parameters: {p: 1}}\n/skin/demo1: {ros__parameters: {p: 2}}', 'f')
    blocks += parse_parameters('/**: {ros__parameters: {p: 3}}', '-p')
    assert resolve_parameters('/skin/demo1', blocks)['p'].value == 2


def test_bare_name_matches_only_the_root_namespace() -> None:
    blocks = parse_parameters('demo1: {ros__parameters: {p: 1}}', 'f')
    assert resolve_parameters('/demo1', blocks)
    assert not resolve_parameters('/skin/demo1', blocks)


def test_nested_maps_are_dotted_names_and_nested_namespaces_are_node_names() -> None:
    blocks = parse_parameters('skin: {demo1: {ros__parameters: {a: {b: 1.5}}}}', 'f')
    assert resolve_parameters('/skin/demo1', blocks)['a.b'].value == 1.5


def test_mixed_list_is_refused_with_its_line() -> None:
    with pytest.raises(ConfigurationError, match=r'^f:3: .*mixes float and int'):
        parse_parameters('/a:\n  ros__parameters:\n    p: [1, 2.0]', 'f')


@pytest.mark.parametrize('text', ['[1]', 'a: 1', 'a: {ros__parameters: 3}', 'a: {ros__parameters: {p: }}', 'a: [', '%'])
def test_broken_parameter_files_are_one_sentence_with_the_file_name(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r'^f:\d+: '):
        parse_parameters(text, 'f')


def test_missing_file_is_a_configuration_error(tmp_path: object) -> None:
    with pytest.raises(ConfigurationError, match='cannot read the parameter file'):
        load_parameter_file(f'{tmp_path}/none.yaml')


def test_block_takes_values_and_keeps_its_defaults() -> None:
    block = from_mapping(Block, {'rate': 30.0, 'inner.gain': 2.0, 'crop': [1, 2]})
    assert block == Block(rate=30.0, crop=(1, 2), inner=Inner(gain=2.0))
    assert from_mapping(Block, to_values(block)) == block


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'rate': 30}, r"'rate' must be a float, got 30 \(int\); write 30\.0"),
        ({'rate': 0.5}, r"'rate' must be from 1\.0 to 240\.0, got 0\.5"),
        ({'rate': math.nan}, r"'rate' must be a number, got nan"),
        ({'offset': math.nan}, r"'offset' must be a number, got nan"),
        ({'rate': math.inf}, r"'rate' must be finite, got inf"),
        ({'offset': -math.inf}, r"'offset' must be finite, got -inf"),
        ({'preset': 'slow'}, r"'preset' must be one of 'fast', 'medium', got 'slow'"),
        ({'preset': 5}, r'put it in quotes: "5"'),
        ({'preset': 'fa\0st'}, r"'preset' must not contain a NUL character"),
        ({'threads': True}, r"'threads' must be a int, got True"),
        ({'crop': 3}, r"'crop' must be a list"),
        ({'ratee': 1.0}, r"unknown parameter 'ratee'; available: crop, inner\.gain"),
        ({'inner.gain': -1.0}, r"'inner\.gain' must be at least 0\.0"),
    ],
)
def test_wrong_value_is_refused_saying_what_would_be_right(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        from_mapping(Block, values)


def test_wrong_value_from_a_file_names_file_and_line() -> None:
    blocks = parse_parameters('/n:\n  ros__parameters:\n    rate: 1\n', 'config/x.yaml')
    with pytest.raises(ConfigurationError, match=r'^config/x\.yaml:3: '):
        from_mapping(Block, resolve_parameters('/n', blocks))


def test_description_carries_type_range_and_default() -> None:
    by_name = {description.name: description for description in describe(Block)}
    assert by_name['rate'].maximum == 240.0
    assert by_name['crop'].type == 'int_array'
    assert by_name['threads'].read_only
    assert by_name['inner.gain'].default == 1.0


def test_a_block_says_for_all_below_it_that_they_are_set_at_start_and_a_block_or_field_in_it_says_otherwise() -> None:
    found = {entry.name: entry.read_only for entry in describe(Machine)}
    assert found == {'port': True, 'label': False, 'inner.gain': True, 'switch.on': False}


def test_a_block_that_names_the_node_is_for_it_alone_and_one_of_wildcards_is_not() -> None:
    text = """
        /**/camera: {ros__parameters: {fpss: 1.0}}
        /other/camera: {ros__parameters: {gain: 1}}
        /**: {ros__parameters: {rate: 1.0}}
        /skin/*: {ros__parameters: {loop: true}}
    """
    blocks = parse_parameters(text, 'a.yaml')
    assert exact_names('/skin/camera', blocks) == {'fpss'}
