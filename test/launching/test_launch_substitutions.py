"""The values of substitutions."""

import os
import re

import pytest

from tactile_nodes import paths
from tactile_nodes.errors import LaunchFileError


@pytest.fixture
def logged(interpret):
    """What `log` prints for a message."""

    def run(message, environment=None, before='', **options):
        quoted = message.replace("'", "''")
        return interpret(f"{before}\n- log: {{message: '{quoted}'}}\n", environment, **options).texts[-1]

    return run


def refusal(logged, message, *arguments, **options):
    with pytest.raises(LaunchFileError) as caught:
        logged(message, *arguments, **options)
    return str(caught.value)


def test_var_gives_a_launch_configuration(logged):
    assert logged('$(var a)', a='value') == 'value'


def test_var_without_value_gives_its_default(logged):
    assert logged('$(var a fallback)') == 'fallback'


def test_an_undefined_var_is_an_error_with_its_line(logged):
    assert "$(var sorce): the launch configuration 'sorce' does not exist; did you mean 'source'?" in refusal(
        logged, '$(var sorce)', source='x'
    )


def test_env_gives_a_variable_of_the_launch(logged):
    assert logged('$(env A)', {'A': 'x'}) == 'x'
    assert logged('$(env A b)', {}) == 'b'


def test_an_undefined_env_is_an_error(logged):
    assert "environment variable 'A' does not exist" in refusal(logged, '$(env A)')


def test_the_share_folder_of_this_package_needs_no_environment(logged):
    assert logged('$(find-pkg-share tactile_nodes)') == str(paths.share_directory())


def test_packages_are_found_by_the_ament_prefix_path(logged, prefix):
    environment = {'AMENT_PREFIX_PATH': f'/nowhere{os.pathsep}{prefix}'}
    assert logged('$(find-pkg-share demo)', environment) == f'{prefix}/share/demo'
    assert logged('$(find-pkg-prefix demo)', environment) == str(prefix)
    assert logged('$(exec-in-pkg talker demo)', environment) == f'{prefix}/lib/demo/talker'


def test_an_unknown_package_is_an_error(logged):
    assert "package 'demo' not found" in refusal(logged, '$(find-pkg-share demo)')


def test_an_unknown_executable_is_an_error_that_suggests(logged, prefix):
    text = refusal(logged, '$(exec-in-pkg talkr demo)', {'AMENT_PREFIX_PATH': str(prefix)})
    assert "has no executable 'talkr'; did you mean 'talker'?" in text


def test_find_exec_searches_the_path_of_the_launch(logged, program, tmp_path):
    path = program('', name='tool')
    assert logged('$(find-exec tool)', {'PATH': str(tmp_path)}) == str(path)
    assert "'tool' not found on the PATH" in refusal(logged, '$(find-exec tool)', {'PATH': '/nowhere'})


def test_dirname_and_filename_are_those_of_the_file(logged, tmp_path):
    assert logged('$(dirname)') == str(tmp_path)
    assert logged('$(filename)') == str(tmp_path / 'test.launch.yaml')


def test_dirname_is_the_includers_again_after_an_include(logged, tmp_path):
    inner = tmp_path / 'inner' / 'a.launch.yaml'
    inner.parent.mkdir()
    inner.write_text('launch: [{let: {name: seen, value: $(dirname)}}]')
    assert logged('$(var seen) $(dirname)', before=f'- include: {{file: {inner}}}') == f'{inner.parent} {tmp_path}'


def test_eval_has_math_and_nested_values(logged):
    assert logged('$(eval "sqrt($(var n)) + math.pi * 0")', n='9') == '3.0'
    assert logged('$(eval "1 + 1" math)') == '2'


def test_eval_with_another_module_is_refused_by_name(logged):
    assert "only the module 'math' is allowed, not os" in refusal(logged, "$(eval 'os.getcwd()' os)")


@pytest.mark.parametrize('call', ["command 'echo hello'", 'anon a', 'log_dir', 'param rate'])
def test_what_ros_2_knows_besides_is_refused_with_what_to_write(logged, call):
    assert re.search(rf"{call.split()[0]}' is not supported: (name|let|set|use) ", refusal(logged, f'$({call})'))


@pytest.mark.parametrize(
    ('message', 'value'),
    [
        ('$(and true on)', 'true'),
        ('$(and true no)', 'false'),
        ('$(or false yes)', 'true'),
        ('$(or false off)', 'false'),
        ('$(not true)', 'false'),
        ('$(not $(and true false))', 'true'),
    ],
)
def test_and_or_not_take_yaml_booleans(logged, message, value):
    assert logged(message) == value


def test_a_number_is_no_boolean_for_and(logged):
    assert "'1' is not a boolean" in refusal(logged, '$(and true 1)')
