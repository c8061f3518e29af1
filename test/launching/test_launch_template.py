"""The grammar of substitutions."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching.substitutions import FUNCTIONS
from tactile_nodes.launching.template import ARITY, Call, Place, Template, parse_template

PLACE = Place(Path('x.launch.yaml'), 7)


class Echo:
    """Gives each call the value ``name(arguments)``."""

    def call(self, name, arguments):
        return f'{name}({",".join(arguments)})'


def value(text):
    return parse_template(text, PLACE).evaluate(Echo())


def test_text_without_substitutions_stays():
    assert value('plain text, with "quotes" and (parentheses)') == 'plain text, with "quotes" and (parentheses)'


def test_a_call_stands_within_text():
    assert value('/a/$(var b)/c') == '/a/var(b)/c'


def test_arguments_are_separated_by_a_space():
    assert value('$(var name default)') == 'var(name,default)'


@pytest.mark.parametrize('text', ['$(var name "a b")', "$(var name 'a b')"])
def test_a_quoted_argument_holds_spaces(text):
    assert value(text) == 'var(name,a b)'


def test_an_empty_default_is_written_as_quotes():
    assert value("$(var name '')") == 'var(name,)'


def test_calls_nest():
    assert value('$(find-pkg-share $(var p$(env N)))') == 'find-pkg-share(var(penv(N)))'


def test_calls_work_within_quotes():
    assert value("""$(eval "'$(var mode)' == 'sim'")""") == "eval('var(mode)' == 'sim')"


def test_a_dollar_without_a_parenthesis_is_text():
    assert value('costs 5$ or $HOME $') == 'costs 5$ or $HOME $'


def test_a_backslash_keeps_a_call_from_being_one():
    assert value(r'\$(var x)') == '$(var x)'


def test_a_backslash_makes_quotes_and_parentheses_plain():
    assert value(r'$(var a\)\(\"\')') == 'var(a)("\')'


def test_a_closed_quote_may_contain_the_other_one():
    assert value("""$(eval 'a "b" c')""") == 'eval(a "b" c)'


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('$(var x', "not closed by ')'"),
        ('$(var  x)', 'two spaces'),
        ('$()', 'name of a substitution'),
        ('$(var "x)', 'quote " is not closed'),
        ('$(var a"b)', 'unquoted quote'),
        ('$(nonsense x)', "'nonsense' does not exist"),
        ('$(equals a b)', 'Humble lacks it'),
        ('$(var)', 'takes 1 or 2 argument(s), got 0'),
        ('$(dirname x)', 'takes 0 argument(s), got 1'),
    ],
)
def test_what_is_not_of_the_grammar_is_an_error_with_file_and_line(text, reason):
    with pytest.raises(LaunchFileError) as caught:
        parse_template(text, PLACE)
    assert str(caught.value).startswith('x.launch.yaml:7: ')
    assert reason in str(caught.value)


def test_deep_nesting_is_an_error():
    with pytest.raises(LaunchFileError, match='nested too deeply'):
        parse_template('$(var ' * 500, PLACE)


def test_every_substitution_of_the_grammar_has_a_value():
    assert set(FUNCTIONS) == set(ARITY)


def escape(text):
    return re.sub(r"""([\\$"'()])""", r'\\\1', text)


@given(st.text())
def test_an_escaped_text_is_itself(text):
    assert value(escape(text)) == text


@given(st.text(alphabet='$() \'"\\abvar-', max_size=40))
def test_any_text_is_read_or_refused(text):
    try:
        parse_template(text, PLACE)
    except LaunchFileError as error:
        assert '\n' not in str(error) or '\n' in text


# Arguments hold anything but line ends, which a backslash does not reach, as in ROS 2.
literals = st.text(alphabet=st.characters(blacklist_categories=['Cs', 'Cc']), min_size=1, max_size=8)


def call_of(argument):
    return Call('var', (Template((argument,), PLACE),))


@given(st.recursive(literals, lambda inner: inner.map(call_of), max_leaves=4))
def test_nested_calls_come_back_as_written(part):
    def written(part, quoted):
        if isinstance(part, str):
            return escape(part).replace(' ', '_') if quoted else escape(part)
        return f'$(var {written(part.arguments[0].parts[0], True)})'

    def expected(part):
        if isinstance(part, str):
            return part.replace(' ', '_')
        return f'var({expected(part.arguments[0].parts[0])})'

    result = expected(part) if isinstance(part, Call) else part
    assert value(written(part, False)) == result
