"""Parameters of a node as its launch file gives them, and as rcl then reads them."""

import re
from pathlib import Path

import pytest
import yaml

from tactile_nodes import params
from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching.hand import parameter_text
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors import load_hand


@pytest.fixture
def files(interpret):
    """The parameter files that a node with these `param` gets."""

    def run(param, node='exec: /n', **options):
        notes = interpret(f'- node: {{{node}, param: {param}}}\n', **options)
        [words] = notes.commands
        return [Path(words[i + 1]) for i, word in enumerate(words) if word == '--params-file']

    return run


@pytest.fixture
def value(files):
    """What rcl reads for one inline parameter."""

    def run(written, **options):
        [file] = files(f'[{{name: x, {written}}}]', **options)
        [block] = params.load_parameter_file(file)
        return block.values['x'].value

    return run


def refusal(files, param, **options):
    with pytest.raises(LaunchFileError) as caught:
        files(param, **options)
    return str(caught.value)


@pytest.mark.parametrize(
    ('node', 'key'),
    [
        ('exec: /n, name: n, namespace: skin', '/skin/n'),
        ('exec: /n, name: n, namespace: /', '/n'),
        ('exec: /n, name: n', '/**'),
        ('exec: /n, namespace: skin', '/**'),
        ('exec: /n', '/**'),
    ],
)
def test_inline_values_are_keyed_by_the_full_name_where_it_is_known(files, node, key):
    [file] = files('[{name: x, value: 1}]', node)
    assert yaml.safe_load(file.read_text()) == {key: {'ros__parameters': {'x': 1}}}


@pytest.mark.parametrize(
    ('written', 'expected'),
    [
        ('value: 1', 1),
        ('value: 1.0', 1.0),
        ('value: 1.0e-7', 1e-7),
        ('value: true', True),
        ("value: 'true'", 'true'),
        ("value: '5'", '5'),
        ('value: text', 'text'),
        ("value: 'it''s \"so\": #1'", 'it\'s "so": #1'),
        ('value: [1, 2]', [1, 2]),
        ('value: [1.0, 2.0]', [1.0, 2.0]),
        ("value: ['1', b]", ['1', 'b']),
        ('value: 5, type: int', 5),
        ('value: [1, 2], type: list_of_int', [1, 2]),
    ],
)
def test_a_literal_keeps_the_type_that_yaml_gives_it(value, written, expected):
    found = value(written)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ('kind', 'text', 'expected'),
    [
        (None, '00012345', 5349),
        (None, '1e5', 100000.0),
        (None, 'on', True),
        (None, '1.5', 1.5),
        (None, '/dev/ttyUSB0', '/dev/ttyUSB0'),
        (None, '[1, 2]', [1, 2]),
        (None, "'5'", '5'),
        ('str', '00012345', '00012345'),
        ('str', '1e5', '1e5'),
        ('str', '', ''),
        ('int', '12', 12),
        ('float', '1', 1.0),
        ('bool', 'yes', True),
        ('list_of_str', "['1', b]", ['1', 'b']),
        ('list_of_float', '[1.0, 2.0]', [1.0, 2.0]),
    ],
)
def test_a_substitution_is_typed_by_yaml_unless_type_says_what_it_is(value, kind, text, expected):
    said = f', type: {kind}' if kind else ''
    found = value(f"value: '$(var a)'{said}", a=text)
    assert found == expected
    assert type(found) is type(expected)


def test_a_list_may_hold_substitutions(value):
    assert value("value: ['$(var a)', b], type: list_of_str", a='1') == ['1', 'b']
    assert value("value: ['$(var a)', '$(var a)']", a='1') == [1, 1]


@pytest.mark.parametrize(
    'written',
    [
        'value: [1, 2.0]',
        'value: []',
        'value: [[1]]',
        'value: {a: 1}',
        'value:',
        'value: 2020-01-01',
        "value: '5', type: int",
        'value: 5, type: float',
        'value: true, type: int',
        'value: [1, a], type: list_of_int',
        'value: 1, type: integer',
        "value: '1e5'",
        'value: y',
        'value: 1, param: [{name: y, value: 2}]',
        'param: [{name: y, value: 2}], type: int',
    ],
)
def test_what_ros_refuses_or_would_mistake_is_an_error(files, written):
    assert ': param: ' in refusal(files, f'[{{name: x, {written}}}]')


@pytest.mark.parametrize('text', ['', 'a: b', '[1, 2.0]', '2020-01-01', '@', '1:2:'])
def test_a_substitution_that_is_no_parameter_is_an_error(files, text):
    assert '.launch.yaml:2: param: ' in refusal(files, "[{name: x, value: '$(var a)'}]", a=text)


@pytest.mark.parametrize('text', ['3', '0.2N'])
def test_a_number_with_a_type_needs_no_point_and_is_named_if_it_is_none(files, text):
    """As with `tactile launch guarded_approach hold_s:=3`."""
    written = "[{name: a, param: [{name: b, value: '$(var hold_s)', type: float}]}]"
    if text == '3':
        assert yaml.safe_load(files(written, hold_s=text)[0].read_text())['/**']['ros__parameters'] == {'a.b': 3.0}
    else:
        assert "param: a.b: '0.2N' is not a valid float" in refusal(files, written, hold_s=text)


@pytest.mark.parametrize('name', ['guarded_approach', 'grasp', 'replay', 'replay_hand', 'live', 'calibrate', 'collect'])
def test_arguments_of_our_launch_files_take_whole_numbers_where_the_default_has_a_fraction(name):
    text = (share_directory() / f'launch/{name}.launch.yaml').read_text()
    for argument in re.findall(r"name: (\w+)\n +default: '\d+\.\d+'", text):
        assert not re.search(rf'value: \$\(var {argument}\)\n(?! +type: float)', text), argument


def test_nested_parameters_have_dotted_names(files):
    [file] = files("[{name: a, param: [{name: b, value: 1}, {name: c, param: [{name: '$(var n)', value: 2}]}]}]", n='d')
    assert yaml.safe_load(file.read_text())['/**']['ros__parameters'] == {'a.b': 1, 'a.c.d': 2}


def test_files_and_values_are_passed_in_the_written_order(files, tmp_path):
    one, two = tmp_path / 'one.yaml', tmp_path / 'two.yaml'
    for file in (one, two):
        file.write_text('n: {ros__parameters: {a: 1}}')
    first, second, third, fourth = files(
        f'[{{name: x, value: 1}}, {{from: {two}}}, {{name: y, value: 2}}, {{from: {one}}}]'
    )
    assert (second, fourth) == (two, one)
    assert 'x:' in first.read_text()
    assert "'y': 2" in third.read_text()


def test_a_missing_parameter_file_is_an_error(files):
    assert refusal(files, '[{from: /none.yaml}]').endswith('the parameter file /none.yaml does not exist')


def test_a_missing_parameter_file_that_an_argument_names_is_asked_for(files):
    said = refusal(files, '[{from: $(var devices)}]', devices='/rigs/real.yaml')
    assert said.endswith('the parameter file /rigs/real.yaml does not exist; give another one with devices:=FILE')


def test_a_parameter_file_that_rcl_would_refuse_is_an_error_with_its_line(files, tmp_path):
    file = tmp_path / 'p.yaml'
    file.write_text('n:\n  ros__parameters:\n    a: [1, 2.0]\n')
    assert f'{file}:3:' in refusal(files, f'[{{from: {file}}}]')


def test_substitutions_in_a_parameter_file_are_made_where_allowed(files, tmp_path):
    file = tmp_path / 'p.yaml'
    file.write_text('/**:\n  ros__parameters:\n    rate: $(var rate)  # Hz\n')
    [plain] = files(f'[{{from: {file}}}]', rate='60.0')
    [made] = files(f'[{{from: {file}, allow_substs: true}}]', rate='60.0')
    assert plain == file
    [block] = params.load_parameter_file(made)
    assert block.values['rate'].value == 60.0


@pytest.mark.parametrize(
    'param', ['[{value: 1}]', '[{name: a, from: b}]', '[{name: a}]', '[{name: a, value: 1, x: 2}]']
)
def test_a_malformed_param_is_an_error(files, param):
    assert ': param: ' in refusal(files, param)


def test_a_list_cannot_be_given_to_all_nodes(interpret):
    with pytest.raises(LaunchFileError, match='a list cannot be given to all nodes'):
        interpret("- set_parameter: {name: a, value: '[1, 2]'}\n")


def test_any_letters_of_a_frame_of_a_hand_reach_its_nodes(tmp_path):
    """A sign beyond the first 65536 of Unicode was written as two halves, which YAML does not join."""
    (tmp_path / 'hand.yaml').write_text("sensors: [{name: a, frame: {id: '🖐'}}]", encoding='utf-8')
    hand = load_hand(tmp_path / 'hand.yaml')
    (tmp_path / 'nodes.yaml').write_text(parameter_text(hand.sensors[0], hand, open_within_s=0.0), encoding='utf-8')
    found = {block.pattern: block.values for block in params.load_parameter_file(tmp_path / 'nodes.yaml')}
    assert found['/**/force_estimator']['frame_id'].value == '🖐'
