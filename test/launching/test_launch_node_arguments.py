"""The words with which a node is started: those that ROS 2 Jazzy was seen to use."""

import sys

import pytest

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching import packages


def refusal(interpret, actions, *arguments, **options):
    with pytest.raises(LaunchFileError) as caught:
        interpret(actions, *arguments, **options)
    return str(caught.value)


def command(interpret, action, *arguments, **options):
    [words] = interpret(f'- {action}\n', *arguments, **options).commands
    return words


def test_every_part_of_a_nodes_command_is_in_its_place(interpret, prefix, tmp_path):
    file = tmp_path / 'p.yaml'
    file.write_text('/**: {ros__parameters: {a: 1}}')
    notes = interpret(
        f"""\
        - set_parameter: {{name: g, value: '1.5'}}
        - set_parameter: {{name: use_sim_time, value: 'true'}}
        - set_parameters_from_file: {{filename: {file}}}
        - set_remap: {{from: a, to: b}}
        - node:
            pkg: demo
            exec: talker
            name: n
            namespace: skin
            args: --flag $(var x)
            ros_args: --log-level debug
            remap:
            - {{from: c, to: d}}
            param:
            - {{from: {file}}}
            - {{name: rate, value: 1.0}}
        """,
        {'AMENT_PREFIX_PATH': str(prefix)},
        x='1 2',
    )
    assert notes.commands == [
        [
            *(f'{prefix}/lib/demo/talker', '--flag', '1 2', '--ros-args', '--log-level', 'debug', '--ros-args'),
            *('-r', '__node:=n', '-r', '__ns:=/skin', '-p', 'g:=1.5', '-p', 'use_sim_time:=True'),
            *('--params-file', str(file), '--params-file', str(file)),
            *('--params-file', f'{tmp_path}/log/launch_params_1.yaml', '-r', 'a:=b', '-r', 'c:=d'),
        ]
    ]


def test_a_node_without_a_package_is_a_path_and_keeps_its_own_name(interpret):
    assert command(interpret, 'node: {exec: /opt/talker}') == ['/opt/talker', '--ros-args']


def test_an_executable_that_its_package_lacks_is_an_error(interpret, prefix, tmp_path):
    text = refusal(interpret, '- node: {pkg: demo, exec: listener}\n', {'AMENT_PREFIX_PATH': str(prefix)})
    assert text == (f"{tmp_path}/test.launch.yaml:2: node: package 'demo' has no executable 'listener'; known: talker")


# --- namespaces ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('pushed', 'given', 'expected'),
    [
        (None, 'skin', '/skin'),
        (None, '/skin/', '/skin'),
        (None, '/', '/'),
        ('skin', None, '/skin'),
        ('skin', 'left', '/skin/left'),
        ('/skin', '/left', '/left'),
    ],
)
def test_a_namespace_is_below_the_pushed_one_unless_absolute(interpret, pushed, given, expected):
    push = f'- push_ros_namespace: {{namespace: {pushed}}}\n' if pushed else ''
    own = f', namespace: {given}' if given else ''
    [words] = interpret(f'{push}- node: {{exec: /n{own}}}\n').commands
    assert words == ['/n', '--ros-args', '-r', f'__ns:={expected}']


def test_pushed_namespaces_add_up(interpret):
    actions = '- push_ros_namespace: {namespace: a}\n- push_ros_namespace: {namespace: b}\n- node: {exec: /n}\n'
    assert interpret(actions).commands == [['/n', '--ros-args', '-r', '__ns:=/a/b']]


@pytest.mark.parametrize('action', ['namespace: 1st', 'namespace: a//b', 'name: a-b', 'name: /a', "name: ''"])
def test_an_invalid_name_is_an_error(interpret, action):
    assert 'is not a valid' in refusal(interpret, f'- node: {{exec: /n, {action}}}\n')


# --- splitting -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('cmd', 'words'),
    [
        ('ls -l /tmp', ['ls', '-l', '/tmp']),
        ("echo 'a b' c", ['echo', 'a b', 'c']),
        ('$(var x)', ['1 2']),
        ('a $(var x) b', ['a', '1 2', 'b']),
        ('a=$(var x)b c', ['a=1 2b', 'c']),
        ('$(var x) $(var x)', ['1 2', '1 2']),
        ('$(var x)$(var x)', ['1 21 2']),
        ('$(find-pkg-share tactile_nodes)/a b', None),
    ],
)
def test_only_literal_text_is_split(interpret, cmd, words):
    found = command(interpret, f'executable: {{cmd: "{cmd}"}}', x='1 2')
    if words is None:
        assert found[0].endswith('/a')
        assert found[1:] == ['b']
    else:
        assert found == words


def test_quotes_may_not_span_a_substitution(interpret):
    text = refusal(interpret, """- executable: {cmd: "echo 'a $(var x) b'"}\n""", x='1')
    assert 'No closing quotation' in text


def test_an_empty_substitution_is_an_empty_argument(interpret):
    assert command(interpret, 'node: {exec: /n, args: $(var x)}', x='') == ['/n', '', '--ros-args']


# --- labels ----------------------------------------------------------------------------------------------------------


def test_processes_are_labelled_by_program_or_name_and_numbered(interpret):
    notes = interpret("""\
        - executable: {cmd: /bin/ls}
        - executable: {cmd: /bin/ls, name: lister}
        - node: {exec: /opt/talker, name: n}
        - node: {exec: /opt/talker, exec_name: left}
        """)
    assert [plan.name for plan in notes.plans] == ['ls-1', 'lister-2', 'talker-3', 'left-4']


def test_a_launch_prefix_stands_in_front(interpret):
    assert command(interpret, "executable: {cmd: ls, launch-prefix: 'nice -n 5'}") == ['nice', '-n', '5', 'ls']


def test_the_launch_prefix_configuration_applies_where_its_filter_matches(interpret):
    actions = '- executable: {cmd: /bin/ls}\n- executable: {cmd: /bin/cat}\n'
    found = interpret(actions, **{'launch-prefix': 'nice', 'launch-prefix-filter': 'l'}).commands
    assert found == [['nice', '/bin/ls'], ['/bin/cat']]


# --- options ---------------------------------------------------------------------------------------------------------


def test_the_options_of_a_process_have_the_defaults_of_ros(interpret):
    [plan] = interpret('- executable: {cmd: ls}\n').plans
    assert (plan.output, plan.respawn, plan.respawn_delay_s, plan.respawn_max_retries) == ('log', False, 0.0, -1)
    assert (plan.sigterm_timeout, plan.sigkill_timeout, plan.required, plan.shell) == ('5', '5', False, False)


def test_timeouts_are_set_by_key_or_by_launch_argument(interpret):
    actions = '- executable: {cmd: ls}\n- executable: {cmd: ls, sigterm_timeout: 1.0}\n'
    plans = interpret(actions, sigterm_timeout='2').plans
    assert [plan.sigterm_timeout for plan in plans] == ['2', '1.0']


def test_respawn_is_a_text_with_a_yaml_boolean(interpret):
    assert interpret("- executable: {cmd: ls, respawn: '$(var r)'}\n", r='on').plans[0].respawn
    assert "'1' is not a boolean" in refusal(interpret, "- executable: {cmd: ls, respawn: '1'}\n")


def test_an_unknown_output_is_an_error(interpret):
    assert "got 'loud'" in refusal(interpret, '- executable: {cmd: ls, output: loud}\n')


# --- nodes of this package -------------------------------------------------------------------------------------------


def test_a_colcon_build_of_this_package_comes_first(prefix):
    (prefix / 'share/ament_index/resource_index/packages/tactile_nodes').touch()
    program = prefix / 'lib/tactile_nodes/camera_node'
    program.parent.mkdir()
    program.write_text('#!/bin/sh\n')
    program.chmod(0o755)
    environment = {'AMENT_PREFIX_PATH': str(prefix)}
    assert packages.command_of('tactile_nodes', 'camera_node', environment) == [str(program)]


def test_a_console_script_beside_the_interpreter_comes_next(program, monkeypatch, tmp_path):
    script = program('', name='tactile_camera_node')
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'python'))
    monkeypatch.setattr(packages, 'own_executables', lambda: {'camera_node': 'tactile_nodes.nodes.camera'})
    assert packages.command_of('tactile_nodes', 'camera_node', {}) == [str(script)]


def test_in_a_source_tree_a_node_is_a_module_that_can_be_imported_from_anywhere(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'python'))
    monkeypatch.setattr(packages, 'own_executables', lambda: {'camera_node': 'tactile_nodes.nodes.camera'})
    words = packages.command_of('tactile_nodes', 'camera_node', {})
    assert words == [str(tmp_path / 'python'), '-m', 'tactile_nodes.nodes.composed', 'camera']
    root = packages.source_environment(words)['PYTHONPATH'].split(':')[0]
    assert root == str(packages.prefix_of('tactile_nodes', {}))
