"""Describe a launch file: its arguments and its actions, with includes expanded where possible."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching.actions import Action, Argument, Group, Include, Timer
from tactile_nodes.launching.context import Context
from tactile_nodes.launching.document import Item
from tactile_nodes.launching.reading import read_file
from tactile_nodes.launching.template import Call, Template

_MAX_INCLUDES = 20


@dataclass(frozen=True)
class DeclaredArgument:
    """An argument of a launch file; `conditional` if it is used only under some condition."""

    argument: Argument
    conditional: bool


def declared_arguments(file: Path, given: Mapping[str, str] = MappingProxyType({})) -> list[DeclaredArgument]:
    """The arguments of a file and of those it includes, in order, each name once.

    Which files are included may depend on the arguments `given`, and on defaults.

    Raises:
        LaunchFileError: the file has an error.
    """
    found: dict[str, DeclaredArgument] = {}
    for declared in _declared(read_file(file), _context(file, given), conditional=False, depth=0):
        found.setdefault(declared.argument.name, declared)
    return list(found.values())


def arguments_text(file: Path) -> str:
    declared = declared_arguments(file)
    lines = ["Arguments (pass arguments as '<name>:=<value>'):"]
    for each in declared:
        lines += ['', f"    '{each.argument.name}':{'*' * each.conditional}", f'        {each.argument.description}']
        if each.argument.default is not None:
            lines.append(f'        (default: {_default(each.argument.default)})')
    if not declared:
        lines += ['', '  No arguments.']
    if any(each.conditional for each in declared):
        lines += ['', '* argument(s) which are only used if specific conditions occur']
    return '\n'.join(lines)


def file_text(file: Path) -> str:
    """The output of ``--print``: one line per action, its children indented below it."""
    return '\n'.join([str(file), *_lines(read_file(file), _context(file, {}), '', 0)])


def _declared(
    actions: tuple[Action, ...], context: Context, *, conditional: bool, depth: int
) -> Iterator[DeclaredArgument]:
    for action in actions:
        under = conditional or action.condition is not None
        if isinstance(action.effect, Argument):
            _preset(context, action.effect)
            yield DeclaredArgument(action.effect, under)
        elif isinstance(action.effect, (Group, Timer)):
            under = under or isinstance(action.effect, Timer)
            yield from _declared(action.effect.children, context, conditional=under, depth=depth)
        elif isinstance(action.effect, Include) and (included := _included(action.effect, context, depth)):
            set_here = {pair.name.literal for pair in action.effect.arguments}
            with context.inside(included):
                for declared in _declared(read_file(included), context, conditional=under, depth=depth + 1):
                    if declared.argument.name not in set_here:
                        yield declared


def _context(file: Path, given: Mapping[str, str]) -> Context:
    context = Context(os.environ, file.parent, file=file.absolute())
    context.configurations.update(given)
    return context


def _preset(context: Context, argument: Argument) -> None:
    """Give an argument its default, unless it has a value or its default depends on the state of the running launch."""
    if argument.default is not None and argument.name not in context.configurations:
        with suppress(LaunchFileError):
            context.configurations[argument.name] = argument.default.evaluate(context)


def _included(include: Include, context: Context, depth: int) -> Path | None:
    """The included file, if it does not depend on the state of the running launch."""
    try:
        found = Path(include.file.evaluate(context)).absolute()
    except LaunchFileError:
        return None
    return found if found.is_file() and depth < _MAX_INCLUDES else None


def _default(template: Template) -> str:
    return ' + '.join(_part(part) for part in template.parts) or "''"


def _part(part: str | Call) -> str:
    return str(part) if isinstance(part, Call) else f"'{part}'"


def _lines(actions: tuple[Action, ...], context: Context, indent: str, depth: int) -> Iterator[str]:
    for index, action in enumerate(actions):
        last = index == len(actions) - 1
        yield f'{indent}{"└── " if last else "├── "}{action.name}{_details(action.item)}'
        inner = indent + ('    ' if last else '│   ')
        if isinstance(action.effect, Argument):
            _preset(context, action.effect)
        elif isinstance(action.effect, (Group, Timer)):
            yield from _lines(action.effect.children, context, inner, depth)
        elif isinstance(action.effect, Include) and (included := _included(action.effect, context, depth)):
            with context.inside(included):
                yield from _lines(read_file(included), context, inner, depth + 1)


def _details(item: Item) -> str:
    return ''.join(f' {key}={_shown(value)}' for key, value in item.value.items() if key != 'children')


def _shown(item: Item) -> str:
    if isinstance(item.value, list):
        return f'[{", ".join(_shown(each) for each in item.value)}]'
    if isinstance(item.value, dict):
        return f'{{{", ".join(f"{key}: {_shown(value)}" for key, value in item.value.items())}}}'
    return str(item.value)
