"""Text with substitutions: ``$(find-pkg-share tactile_nodes)/config/$(var sensor).yaml`` -> literal parts and calls.

The grammar is that of ROS 2's launch frontend:

* ``$(name a b)`` is a call, unless a backslash stands before the dollar; its arguments are separated by one space;
* an argument is a quoted string, ``'…'`` or ``"…"``, or a run of characters and calls without a space; inside quotes,
  spaces are kept and calls still work, but the arguments of those calls cannot be quoted again;
* a backslash makes the next character literal, everywhere.

A call's name and the number of its arguments are checked when the file is read, its value when it runs.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tactile_nodes.errors import ConfigurationError, LaunchFileError

# name -> least and most arguments
ARITY: dict[str, tuple[int, int]] = {
    'and': (2, 2),
    'dirname': (0, 0),
    'env': (1, 2),
    'eval': (1, 2),
    'exec-in-pkg': (2, 2),
    'filename': (0, 0),
    'find-exec': (1, 1),
    'find-pkg-prefix': (1, 1),
    'find-pkg-share': (1, 1),
    'not': (1, 1),
    'or': (2, 2),
    'var': (1, 2),
}
# ROS 2 also has these
INSTEAD = {
    'anon': 'name the node',
    'command': 'let the shell pass its output as an argument: name:=$(command)',
    'log_dir': 'set ROS_LOG_DIR and use $(env ROS_LOG_DIR)',
    'param': 'use an argument and $(var …)',
}
# ROS 2 distributions after Humble have these; a file for all distributions cannot use them.
NEWER = {'equals', 'not-equals', 'if', 'any', 'all', 'file-content', 'string-join', 'path-join', 'for-var', 'index'}

_IDENTIFIER = re.compile(r'[A-Za-z][A-Za-z0-9_-]*')
_MAX_DEPTH = 40


class SubstitutionError(Exception):
    """A call without a value; `Template.evaluate` turns it into a `LaunchFileError` with its location."""


@dataclass(frozen=True)
class Place:
    """A line of a launch file, counted from 1."""

    file: Path
    line: int

    def error(self, text: str) -> ConfigurationError:
        return LaunchFileError.at(self.file, self.line, text)


class Caller(Protocol):
    """Gives calls their values: the context of a running launch."""

    def call(self, name: str, arguments: list[str]) -> str:
        """The value of ``$(name arguments…)``, or `SubstitutionError`."""
        ...


@dataclass(frozen=True)
class Call:
    """``$(name arguments…)``."""

    name: str
    arguments: tuple[Template, ...]

    def __str__(self) -> str:
        return f'$({" ".join([self.name, *map(_quoted, self.arguments)])})'


@dataclass(frozen=True)
class Template:
    """Literal strings and calls, to be joined."""

    parts: tuple[str | Call, ...]
    place: Place

    @property
    def literal(self) -> str | None:
        """The string, if it contains no call."""
        if any(isinstance(part, Call) for part in self.parts):
            return None
        return ''.join(str(part) for part in self.parts)

    def evaluate(self, caller: Caller) -> str:
        """The string with every call replaced by its value.

        Raises:
            LaunchFileError: a call has no value.
        """
        return ''.join(part if isinstance(part, str) else self._value(part, caller) for part in self.parts)

    def _value(self, call: Call, caller: Caller) -> str:
        arguments = [argument.evaluate(caller) for argument in call.arguments]
        try:
            return caller.call(call.name, arguments)
        except SubstitutionError as error:
            raise self.place.error(f'{call}: {error}') from error

    def __str__(self) -> str:
        return ''.join(map(str, self.parts))


def parse_template(text: str, place: Place) -> Template:
    """Parse a string with substitutions.

    Raises:
        LaunchFileError: a syntax error, an unknown substitution, or a wrong number of arguments.
    """
    if '$' not in text:
        return Template((unescape(text),), place)
    return _Parser(text, place).template()


def unescape(text: str) -> str:
    r"""``\x`` becomes ``x``."""
    return re.sub(r'\\(.)', r'\1', text)


def _quoted(argument: Template) -> str:
    text = str(argument)
    return f"'{text}'" if not text or re.search(r'[\s\'"]', text) else text


class _Parser:
    """Recursive descent; `quote` is the quote character around the current position, or empty."""

    def __init__(self, text: str, place: Place) -> None:
        self.text = text
        self.place = place
        self.at = 0

    def template(self) -> Template:
        parts: list[str | Call] = []
        while self.at < len(self.text):
            parts.append(self.call('', 0) if self.starts_call() else self.run(lambda _: False))
        return Template(tuple(parts), self.place)

    def call(self, quote: str, depth: int) -> Call:
        if depth > _MAX_DEPTH:
            raise self.refusal('substitutions are nested too deeply')
        self.at += 2
        found = _IDENTIFIER.match(self.text, self.at)
        if found is None:
            raise self.refusal("'$(' must be followed by the name of a substitution; for a literal '$(' write '\\$('")
        self.at = found.end()
        arguments: list[Template] = []
        while self.take(' '):
            arguments.append(self.argument(quote, depth))
        if not self.take(')'):
            raise self.refusal(f"'$({found[0]}' is not closed by ')', or has an unquoted quote, parenthesis or space")
        self.check(found[0], len(arguments))
        return Call(found[0], tuple(arguments))

    def argument(self, quote: str, depth: int) -> Template:
        if not quote and self.peek() in {'"', "'"}:
            return self.quoted(depth)
        parts: list[str | Call] = []
        while self.at < len(self.text):
            if self.starts_call():
                parts.append(self.call(quote, depth + 1))
            elif self.ends_argument(quote, self.at):
                break
            else:
                parts.append(self.run(lambda at: self.ends_argument(quote, at)))
        if not parts:
            raise self.refusal("an argument is empty (two spaces?); for an empty string write ''")
        return Template(tuple(parts), self.place)

    def quoted(self, depth: int) -> Template:
        quote = self.peek()
        self.at += 1
        parts: list[str | Call] = []
        while self.at < len(self.text) and self.peek() != quote:
            at_quote = self.is_plain(quote)
            parts.append(self.call(quote, depth + 1) if self.starts_call() else self.run(at_quote))
        if not self.take(quote):
            raise self.refusal(f'the quote {quote} is not closed')
        return Template(tuple(parts), self.place)

    def run(self, ends: _Ends) -> str:
        """The literal string up to a call or to where `ends` returns true."""
        start = self.at
        while self.at < len(self.text) and not self.starts_call() and not ends(self.at):
            self.at += 2 if self.text[self.at] == '\\' and self.at + 1 < len(self.text) else 1
        return unescape(self.text[start : self.at])

    def is_plain(self, characters: str) -> _Ends:
        return lambda at: self.text[at] in characters

    def ends_argument(self, quote: str, at: int) -> bool:
        return self.text[at] in (' ()' + (quote or '"\''))

    def starts_call(self) -> bool:
        return self.text.startswith('$(', self.at)

    def peek(self) -> str:
        return self.text[self.at : self.at + 1]

    def take(self, character: str) -> bool:
        found = self.peek() == character
        self.at += found
        return found

    def check(self, name: str, count: int) -> None:
        if name not in ARITY:
            why = 'is not supported, because ROS 2 Humble lacks it' if name in NEWER else 'does not exist'
            instead = f'is not supported: {INSTEAD[name]}' if name in INSTEAD else f'{why}; known: {", ".join(ARITY)}'
            raise self.refusal(f"the substitution '{name}' {instead}")
        least, most = ARITY[name]
        if not least <= count <= most:
            expected = str(least) if least == most else f'{least} or {most}'
            raise self.refusal(f"the substitution '{name}' takes {expected} argument(s), got {count}")

    def refusal(self, why: str) -> ConfigurationError:
        shown = self.text if len(self.text) <= 80 else self.text[:77] + '...'
        return self.place.error(f'{why}; in: {shown}')


class _Ends(Protocol):
    def __call__(self, at: int, /) -> bool: ...
