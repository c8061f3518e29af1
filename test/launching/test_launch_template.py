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


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        pytest.param('plain, "quotes" and (parentheses)', 'plain, "quotes" and (parentheses)', id='no call'),
        pytest.param('costs 5$ or $HOME $', 'costs 5$ or $HOME $', id='a dollar without a parenthesis'),
        pytest.param('/a/$(var b)/c', '/a/var(b)/c', id='a call within text'),
        pytest.param('$(var name default)', 'var(name,default)', id='a space separates arguments'),
        pytest.param('$(var name "a b")', 'var(name,a b)', id='a quoted argument holds spaces'),
        pytest.param("$(var name 'a b')", 'var(name,a b)', id='in either quotes'),
        pytest.param("$(var name '')", 'var(name,)', id='an empty default'),
        pytest.param("""$(eval 'a "b" c')""", 'eval(a "b" c)', id='a quote in the other one'),
        pytest.param('$(find-pkg-share $(var p$(env N)))', 'find-pkg-share(var(penv(N)))', id='calls nest'),
        pytest.param("""$(eval "'$(var m)' == 'a'")""", "eval('var(m)' == 'a')", id='a call within quotes'),
        pytest.param(r'\$(var x)', '$(var x)', id='a backslash before a call'),
        pytest.param(r'$(var a\)\(\"\')', 'var(a)("\')', id='backslashes within a call'),
    ],
)
def test_calls_in_a_text_are_replaced_by_their_values(text, expected):
    assert value(text) == expected


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
