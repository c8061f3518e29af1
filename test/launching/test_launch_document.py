"""The shape of a launch file, and its types, which are not converted."""

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching.reading import READERS, read_file


def refusal(file):
    with pytest.raises(LaunchFileError) as caught:
        read_file(file)
    return str(caught.value)


@pytest.mark.parametrize(
    'text',
    ['', '[]', 'launch', 'run: []', 'launch: []\nother: []', 'launch: {log: {message: a}}', 'launch:'],
)
def test_a_file_has_one_root_key_launch_with_a_list(tmp_path, text):
    file = tmp_path / 'a.launch.yaml'
    file.write_text(text)
    assert refusal(file).startswith(f'{file}:1: ')


def test_an_item_has_one_key(launch_file):
    file = launch_file("""\
        - log: {message: a}
        - log: {message: b}
          let: {name: a, value: b}
        """)
    assert refusal(file) == f'{file}:3: an action is a map with one key, its name; found: log, let'


def test_an_unknown_action_is_named_with_its_line(launch_file):
    file = launch_file('- log: {message: a}\n- nodes: {exec: a}\n')
    assert refusal(file) == f"{file}:3: unknown action 'nodes'; did you mean 'node'?"


@pytest.mark.parametrize('name', ['node_container', 'load_composable_node', 'ros_timer', 'set_ros_log_dir', 'for'])
def test_what_is_not_supported_is_refused_by_name(launch_file, name):
    assert f"the action '{name}' is not supported" in refusal(launch_file(f'- {name}: {{}}\n'))


def test_an_unknown_key_is_named_with_its_line(launch_file):
    file = launch_file("""\
        - node:
            pkg: demo
            exec: talker
            respwan: 'true'
        """)
    assert refusal(file) == f"{file}:5: node: unknown key 'respwan'; did you mean 'respawn'?"


@pytest.mark.parametrize(
    'action',
    [
        'arg: {name: a, default: 1}',
        'arg: {name: a, choice: [{value: 1}]}',
        'let: {name: a, value: 1.5}',
        'set_parameter: {name: a, value: 1}',
        'include: {file: a, arg: [{name: a, value: true}]}',
        'log: {message: a, if: true}',
        'log: {message: a, unless: 0}',
        'executable: {cmd: 5}',
        'node: {exec: a, args: 5}',
        'node: {exec: a, output: true}',
        'node: {exec: a, respawn: true}',
        'node: {exec: a, env: [{name: A, value: 1}]}',
    ],
)
def test_these_take_a_string_only_and_nothing_is_converted(launch_file, action):
    assert 'expected str, got' in refusal(launch_file(f'- {action}\n'))


@pytest.mark.parametrize('key', ['respawn_delay', 'sigterm_timeout', 'sigkill_timeout'])
def test_an_integer_for_a_float_is_refused(launch_file, key):
    assert f"'{key}' expected float, got int" in refusal(launch_file(f'- executable: {{cmd: a, {key}: 1}}\n'))
    assert read_file(launch_file(f'- executable: {{cmd: a, {key}: 1.0}}\n'))


def test_the_period_of_a_timer_is_a_float_or_a_string(launch_file):
    assert "'period' expected float, got int" in refusal(launch_file('- timer: {period: 1, children: []}\n'))
    assert read_file(launch_file('- timer: {period: 1.0, children: []}\n'))
    assert read_file(launch_file("- timer: {period: '1', children: []}\n"))


@pytest.mark.parametrize(
    'action',
    [
        "executable: {cmd: a, shell: 'true'}",
        "executable: {cmd: a, emulate_tty: 'true'}",
        "group: {scoped: 'false', children: []}",
        "group: {forwarding: 'false', children: []}",
        "node: {exec: a, param: [{from: a, allow_substs: 'true'}]}",
    ],
)
def test_these_take_a_boolean_only(launch_file, action):
    assert 'expected bool, got str' in refusal(launch_file(f'- {action}\n'))


@pytest.mark.parametrize(
    ('action', 'reason'),
    [
        ('executable: {cmd: a, respawn_delay: .inf}', 'must be finite'),
        ('executable: {cmd: a, respawn_max_retries: 1.0}', 'expected int, got float'),
        ('node: {pkg: a}', "the key 'exec' is missing"),
        ('executable: {name: a}', "the key 'cmd' is missing"),
        ('arg: {default: a}', "the key 'name' is missing"),
        ('group: {scoped: true}', "the key 'children' is missing"),
        ('node: {exec: a, on_exit: restart}', "'on_exit' takes 'shutdown'"),
        ('node: {exec: a, respawn_delay: -1.0}', 'must not be negative'),
        ('node: {exec: a, param: []}', 'list of maps'),
        ('node: {exec: a, remap: {from: a, to: b}}', 'list of maps'),
        ("log: {message: a, if: 'true', unless: 'true'}", 'cannot be used together'),
        ('log: {message: a, message: b}', 'given twice'),
        ('log:', 'expected a map, got nothing'),
        ('set_env: {name: A, value: b}', 'is not supported: give each process its env'),
        ('reset: {}', 'is not supported: use a group with forwarding: false'),
        ('log: {1: a}', 'a key must be a str'),
    ],
)
def test_a_wrong_action_says_what_is_wrong(launch_file, action, reason):
    assert reason in refusal(launch_file(f'- {action}\n'))


@pytest.mark.parametrize('suffix', ['.launch.py', '.launch.xml'])
def test_other_formats_are_refused_by_name(tmp_path, suffix):
    assert 'launch files are not supported' in refusal(tmp_path / f'a{suffix}')


def test_a_missing_file_is_one_sentence(tmp_path):
    assert refusal(tmp_path / 'none.launch.yaml').endswith('No such file or directory')


def test_an_alias_that_holds_itself_is_refused(launch_file):
    assert 'too deeply' in refusal(launch_file('- group: &a [{group: *a}]\n'))


def test_aliases_cannot_fill_the_memory(tmp_path):
    file = tmp_path / 'a.launch.yaml'
    levels = '\n'.join(f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 10))
    file.write_text(f'a0: &a0 [x]\n{levels}\nlaunch: []\n')
    assert 'too large' in refusal(file)


@pytest.mark.parametrize(
    'text', ['launch: [', 'launch: "\x00"', 'launch: !!python/object:os.system {}', '\tlaunch: []']
)
def test_what_is_no_yaml_is_one_sentence(tmp_path, text):
    file = tmp_path / 'a.launch.yaml'
    file.write_text(text)
    assert str(file) in refusal(file)


scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.sampled_from(['a', '$(var a)'])
)
keys = st.sampled_from(
    ['name', 'value', 'exec', 'pkg', 'cmd', 'children', 'param', 'remap', 'from', 'to', 'if', 'file', 'arg', 'period',
     'env']
)  # fmt: skip
contents = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(keys, inner, max_size=4),
        st.dictionaries(st.sampled_from(sorted(READERS)), inner, max_size=1),
    ),
    max_leaves=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(st.text(alphabet='launch: []{}&*!|>-\n\'"#,0.x?%@`\t\x7f', max_size=60))
def test_any_text_is_read_or_refused(tmp_path, text):
    file = tmp_path / 'fuzz.launch.yaml'
    file.write_text('launch:' + text, encoding='utf-8')
    try:
        read_file(file)
    except LaunchFileError as error:
        assert str(file) in str(error)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(st.lists(st.dictionaries(st.sampled_from(sorted(READERS)), contents, min_size=1, max_size=1), max_size=3))
def test_any_actions_run_or_are_refused(interpret, actions):
    text = yaml.dump(actions, allow_unicode=True) if actions else '[]'
    try:
        interpret(text, {'A': 'a'})
    except LaunchFileError as error:
        assert '.launch.yaml:' in str(error)


TEXTS = st.text(alphabet='$()varevl \'"ab01.\\[]{}:-/*', max_size=12)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200, deadline=None)
@given(TEXTS, TEXTS, TEXTS)
def test_any_texts_in_a_node_run_or_are_refused(interpret, one, two, three):
    node = {
        'exec': one,
        'args': two,
        'launch-prefix': three,
        'param': [{'name': two, 'value': '$(var x)' + one}, {'name': 'b', 'value': three, 'type': 'str'}],
        'remap': [{'from': one, 'to': two}],
    }
    actions = [{'let': {'name': 'x', 'value': three}}, {'node': node}, {'executable': {'cmd': three}}]
    try:
        interpret(yaml.dump(actions, allow_unicode=True))
    except LaunchFileError as error:
        assert '.launch.yaml:' in str(error)
