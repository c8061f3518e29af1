"""What the actions of a launch file do, in order and in scope."""

import pytest

from tactile_nodes.errors import LaunchFileError


def refusal(interpret, actions, *arguments, **options):
    with pytest.raises(LaunchFileError) as caught:
        interpret(actions, *arguments, **options)
    return str(caught.value)


# --- arguments -------------------------------------------------------------------------------------------------------


DEFAULT = "- arg: {name: a, default: '1'}\n"
LET = "- let: {name: a, value: '0'}\n"


@pytest.mark.parametrize(
    ('actions', 'given', 'expected'),
    [
        pytest.param(DEFAULT, {}, '1', id='an argument takes its default'),
        pytest.param(DEFAULT, {'a': '2'}, '2', id='a given one wins over the default'),
        pytest.param(LET + DEFAULT, {}, '0', id='what let set before stays'),
        pytest.param(LET, {'a': '2'}, '0', id='let changes a given one'),
        pytest.param('- arg: {name: b, default: x}\n- arg: {name: a, default: $(var b)y}\n', {}, 'xy', id='refers'),
    ],
)
def test_an_argument_has_the_value_of_ros(interpret, actions, given, expected):
    assert interpret(f'{actions}- log: {{message: $(var a)}}\n', **given).texts == [expected]


def test_a_missing_argument_is_an_error_with_its_line(interpret, tmp_path):
    assert refusal(interpret, '- arg: {name: a, description: what it is}\n') == (
        f"{tmp_path}/test.launch.yaml:2: included launch description missing required argument 'a' "
        "(description: 'what it is'), given: []"
    )


def test_an_argument_behind_a_condition_is_missing_only_when_reached(interpret):
    actions = "- arg: {name: a, if: '$(var need)'}\n"
    assert interpret(actions, need='false').texts == []
    assert "required launch argument 'a' was not provided" in refusal(interpret, actions, need='true')


def test_a_value_that_is_no_choice_is_an_error(interpret):
    actions = '- arg: {name: a, default: x, choice: [{value: x}, {value: y}]}\n'
    assert interpret(actions, a='y')
    assert "provided value 'z' is not valid; valid options are: ['x', 'y']" in refusal(interpret, actions, a='z')


# --- conditions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(('text', 'run'), [('true', True), ('TRUE', True), ('1', True), ('False', False), ('0', False)])
def test_if_and_unless_take_true_1_false_and_0(interpret, text, run):
    assert bool(interpret(f"- log: {{message: x, if: '{text}'}}\n").texts) is run
    assert bool(interpret(f"- log: {{message: x, unless: '{text}'}}\n").texts) is not run


@pytest.mark.parametrize('text', ['yes', 'on', '2', ''])
def test_any_other_condition_is_an_error(interpret, text):
    assert f"a condition must be 'true', '1', 'false' or '0', got '{text}'" in refusal(
        interpret, f"- log: {{message: x, if: '{text}'}}\n"
    )


# --- scopes ----------------------------------------------------------------------------------------------------------


def test_what_an_include_sets_leaks_into_the_includer(interpret, launch_file):
    inner = launch_file('- arg: {name: a, default: x}\n- let: {name: b, value: y}\n', 'inner.launch.yaml')
    actions = f'- include: {{file: {inner}, arg: [{{name: a, value: given}}]}}\n- log: {{message: $(var a) $(var b)}}\n'
    assert interpret(actions).texts == ['given y']


def test_an_include_without_a_required_argument_is_an_error(interpret, launch_file):
    inner = launch_file('- arg: {name: a}\n', 'inner.launch.yaml')
    text = refusal(interpret, f"- let: {{name: a, value: '1'}}\n- include: {{file: {inner}}}\n")
    assert text.startswith(f'{inner}:2: included launch description missing required argument')


def test_an_include_of_no_file_is_an_error_at_the_include(interpret, tmp_path):
    text = refusal(interpret, '- include: {file: $(dirname)/none.launch.yaml}\n')
    assert text == f'{tmp_path}/test.launch.yaml:2: the included launch file {tmp_path}/none.launch.yaml does not exist'


def test_a_file_that_includes_itself_is_an_error(interpret):
    assert 'nested too deeply' in refusal(interpret, '- include: {file: $(filename)}\n')


SCOPED = """\
- let: {name: a, value: outer}
- push_ros_namespace: {namespace: outer}
- set_remap: {from: x, to: outer}
- set_parameter: {name: p, value: outer}
- group:
    scoped: %s
    keep: [{name: b, value: kept}]
    children:
    - log: {message: $(var b)}
    - let: {name: a, value: inner}
    - push_ros_namespace: {namespace: inner}
    - set_remap: {from: y, to: inner}
    - set_parameter: {name: q, value: inner}
- log: {message: $(var a)}
- node: {exec: /n}
"""


@pytest.mark.parametrize(
    ('scoped', 'text', 'words'),
    [
        ('true', 'outer', '__ns:=/outer -p p:=outer -r x:=outer'),
        ('false', 'inner', '__ns:=/outer/inner -p p:=outer -p q:=inner -r x:=outer -r y:=inner'),
    ],
)
def test_what_a_group_sets_leaks_unless_it_is_scoped(interpret, scoped, text, words):
    notes = interpret(SCOPED % scoped)
    assert notes.texts == ['kept', text]
    assert notes.commands == [['/n', '--ros-args', '-r', *words.split()]]


def test_a_group_may_be_a_list(interpret):
    actions = "- let: {name: a, value: '1'}\n- group:\n  - let: {name: a, value: '2'}\n- log: {message: $(var a)}\n"
    assert interpret(actions).texts == ['1']


def test_a_group_without_forwarding_keeps_only_what_it_names(interpret):
    actions = """\
        - let: {name: a, value: '1'}
        - let: {name: b, value: '2'}
        - group:
            forwarding: false
            keep: [{name: a, value: $(var a)}]
            children:
            - log: {message: $(var a) $(var b none)}
        """
    assert interpret(actions).texts == ['1 none']


# --- the rest --------------------------------------------------------------------------------------------------------


def test_log_speaks_as_launch_user(interpret):
    [line] = interpret('- log: {message: hello}\n').lines
    assert str(line) == '[INFO] [launch.user]: hello'


def test_a_timer_runs_its_children_later_in_the_scope_then_in_force(interpret):
    notes = interpret("""\
        - let: {name: a, value: before}
        - timer: {period: 0.5, children: [{log: {message: $(var a)}}]}
        - let: {name: a, value: after}
        """)
    [(seconds, actions, _, cancel)] = notes.timers
    assert (seconds, cancel) == (0.5, True)
    notes.interpreter.perform(actions)
    assert notes.texts == ['after']


def test_the_period_of_a_timer_may_be_a_substitution(interpret):
    actions = "- timer: {period: '$(var t)', cancel_on_shutdown: false, children: []}\n"
    assert [timer[0::3] for timer in interpret(actions, t='2').timers] == [(2.0, False)]
    assert "'soon' is not a number" in refusal(interpret, actions, t='soon')
    assert "'inf' is not a finite number" in refusal(interpret, actions, t='inf')


def test_shutdown_gives_its_reason(interpret):
    assert interpret('- shutdown: {reason: done with $(dirname)}\n').shutdowns[0].startswith('done with /')
    assert interpret('- shutdown: {}\n').shutdowns == ['reason not given']
