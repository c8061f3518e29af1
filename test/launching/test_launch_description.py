"""What the command line shows of a launch file, and how it finds one."""

import argparse

import pytest

from tactile_nodes import paths
from tactile_nodes.cli import launch as launch_command
from tactile_nodes.cli import run as run_command
from tactile_nodes.errors import ConfigurationError, LaunchFileError
from tactile_nodes.launching import description, files

ARGUMENTS = """\
- arg: {name: plain}
- arg: {name: text, default: some text, description: what it is}
- arg: {name: made, default: $(var text)/x}
- arg: {name: mode, default: a, description: how it works, choice: [{value: a}, {value: b}]}
- arg: {name: rare, default: '', if: $(var mode)}
"""


@pytest.fixture
def own_launch_folder(tmp_path, monkeypatch):
    """A share folder of this package with the launch files live and replay."""
    share = tmp_path / 'share'
    (share / 'launch').mkdir(parents=True)
    for name in ('live', 'replay'):
        (share / 'launch' / f'{name}.launch.yaml').write_text('launch: []')
    monkeypatch.setattr(paths, 'share_directory', lambda: share)
    return share / 'launch'


def test_show_args_prints_what_ros_prints(launch_file):
    assert (
        description.arguments_text(launch_file(ARGUMENTS))
        == """\
Arguments (pass arguments as '<name>:=<value>'):

    'plain':
        no description given

    'text':
        what it is
        (default: 'some text')

    'made':
        no description given
        (default: $(var text) + '/x')

    'mode':
        how it works. Valid choices are: ['a', 'b']
        (default: 'a')

    'rare':*
        no description given
        (default: '')

* argument(s) which are only used if specific conditions occur"""
    )


def test_a_file_without_arguments_says_so(launch_file):
    assert description.arguments_text(launch_file('- log: {message: a}\n')).endswith('\n\n  No arguments.')


def test_arguments_of_included_files_are_shown_unless_given(launch_file):
    launch_file("- arg: {name: given, default: ''}\n- arg: {name: open, default: ''}\n", 'inner.launch.yaml')
    outer = launch_file('- include: {file: $(dirname)/inner.launch.yaml, arg: [{name: given, value: x}]}\n')
    assert [each.argument.name for each in description.declared_arguments(outer)] == ['open']


def test_arguments_of_a_file_that_an_argument_names_are_known(launch_file):
    for robot in ('arm', 'hand'):
        launch_file(f'- arg: {{name: {robot}_speed, default: "1"}}\n', name=f'{robot}.launch.yaml')
    outer = launch_file('- arg: {name: robot, default: arm}\n- include: {file: $(dirname)/$(var robot).launch.yaml}\n')
    names = [
        [each.argument.name for each in description.declared_arguments(outer, given)]
        for given in ({}, {'robot': 'hand'})
    ]
    assert names == [['robot', 'arm_speed'], ['robot', 'hand_speed']]


def test_print_shows_one_line_an_action_with_includes_unfolded(launch_file):
    launch_file('- log: {message: inner}\n', 'inner.launch.yaml')
    outer = launch_file("""\
        - include: {file: $(dirname)/inner.launch.yaml}
        - group:
            if: $(var x)
            children:
            - node: {exec: a, param: [{name: p, value: 1}]}
        """)
    assert description.file_text(outer).splitlines() == [
        str(outer),
        '├── include file=$(dirname)/inner.launch.yaml',
        '│   └── log message=inner',
        '└── group if=$(var x)',
        '    └── node exec=a param=[{name: p, value: 1}]',
    ]


def test_a_file_is_found_by_path_with_its_arguments(launch_file):
    file = launch_file('- log: {message: a}\n')
    assert files.resolve([str(file), 'a:=b'], {}) == (file, ['a:=b'])


def test_a_file_is_found_anywhere_below_its_package(prefix):
    environment = {'AMENT_PREFIX_PATH': str(prefix)}
    found, rest = files.resolve(['demo', 'demo.launch.yaml', 'a:=b'], environment)
    assert (found, rest) == (prefix / 'share/demo/launch/demo.launch.yaml', ['a:=b'])
    with pytest.raises(LaunchFileError, match="package 'demo' has no launch file 'other"):
        files.resolve(['demo', 'other.launch.yaml'], environment)


def test_our_own_files_are_found_by_their_bare_names(own_launch_folder):
    assert files.own_names() == ['live', 'replay']
    assert files.resolve(['live', 'a:=b'], {}) == (own_launch_folder / 'live.launch.yaml', ['a:=b'])
    assert files.resolve(['tactile_nodes', 'live'], {})[0] == own_launch_folder / 'live.launch.yaml'
    assert files.resolve(['tactile_nodes', 'live.launch.yaml'], {})[0] == own_launch_folder / 'live.launch.yaml'


def test_a_name_that_is_not_found_brings_the_closest_one(own_launch_folder):
    with pytest.raises(LaunchFileError, match="no launch file 'lve'; did you mean 'live'"):
        files.resolve(['lve'], {})
    with pytest.raises(LaunchFileError, match="package 'tactile_node' not found; did you mean 'tactile_nodes'"):
        files.resolve(['tactile_node', 'live'], {})


def test_the_last_of_several_arguments_wins():
    assert files.parse_arguments(['a:=1', 'b:=x:=y', 'a:=2']) == {'a': '2', 'b': 'x:=y'}


def test_a_tilde_that_the_shell_leaves_is_the_home_folder(monkeypatch):
    """Else a run is recorded into a folder with that name."""
    monkeypatch.setenv('HOME', '/home/me')
    assert files.parse_arguments(['bags:=~/data/', 'name:=a~/b']) == {'bags': '/home/me/data/', 'name': 'a~/b'}


@pytest.mark.parametrize('word', ['a', ':=b', 'a:=', 'a=b'])
def test_a_malformed_argument_is_an_error(word):
    with pytest.raises(LaunchFileError, match='malformed launch argument'):
        files.parse_arguments([word])


def test_completion_offers_files_and_then_their_arguments(own_launch_folder):
    (own_launch_folder / 'live.launch.yaml').write_text("launch: [{arg: {name: source, default: ''}}]")
    assert 'live' in launch_command.complete('', argparse.Namespace(words=[]))
    assert launch_command.complete('', argparse.Namespace(words=['live'])) == ['source:=']


@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        (['camera_node'], ('tactile_nodes', 'camera_node', [])),
        (['tactile_nodes', 'camera_node', '--ros-args'], ('tactile_nodes', 'camera_node', ['--ros-args'])),
        (['demo', 'talker', 'a'], ('demo', 'talker', ['a'])),
    ],
)
def test_run_takes_the_package_or_leaves_it_out(words, expected, prefix, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    assert run_command.split(words) == expected


def test_run_lists_the_executables_of_a_package(prefix, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    with pytest.raises(ConfigurationError, match="name an executable of package 'demo'; available: talker"):
        run_command.split(['demo'])


def test_run_suggests_the_closest_executable(prefix, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    parser = argparse.ArgumentParser()
    run_command.add_arguments(parser)
    with pytest.raises(ConfigurationError, match="no executable 'talkr'; did you mean 'talker'"):
        run_command.run(parser.parse_args(['demo', 'talkr']))
