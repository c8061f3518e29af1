"""The parts of the documentation from the nodes' parameters and the files in ``config/`` and ``launch/``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import cache

import yaml

from reference.nodes import NodeKind, node_kinds
from reference.pages import code, table
from tactile_nodes import params
from tactile_nodes.bus.node.node import NodeParams
from tactile_nodes.params import ParameterDescription
from tactile_nodes.paths import share_directory

_COMMON = {entry.name for entry in params.describe(NodeParams)}
_MANY = 20  # number of shared parameters of two nodes, from which on they are listed once


def nodes() -> str:
    """A table of all nodes."""
    rows = [[code(node.program), code(f'/{node.kind.NAME}'), node.line] for node in node_kinds()]
    return table(['program', 'name', 'description'], rows)


def parameters() -> str:
    """A table of parameters for each node."""
    return '\n\n'.join(_section(node) for node in node_kinds())


def launch_arguments() -> str:
    """A table of arguments for each launch file that ships."""
    files = sorted((share_directory() / 'launch').glob('*.launch.yaml'))
    return '\n\n'.join(
        f'### `tactile launch {file.name.removesuffix(".launch.yaml")}`\n\n'
        + table(['argument', 'default', 'choices', 'description'], _arguments(yaml.safe_load(file.read_text('utf-8'))))
        for file in files
    )


def written(value: object) -> str:
    """A value as written in a parameter file.

    >>> written(True), written(''), written((1.0, 2.0)), written(dataclasses.MISSING)
    ('true', "''", '[1.0, 2.0]', 'must be given')
    """
    if value is dataclasses.MISSING:
        return 'must be given'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f'[{", ".join(map(written, value))}]'
    return "''" if value == '' else str(value)


def _section(node: NodeKind) -> str:
    own = [entry for entry in params.describe(node.kind.PARAMS) if entry.name not in _COMMON]
    title = f'### {node.program}\n\n{node.line} On the bus: `/{node.kind.NAME}`.'
    if other := _told_before(node, own):
        theirs = set(params.describe(other.kind.PARAMS))
        shared = list(dict.fromkeys(_group(entry) for entry in own if entry in theirs))
        title += f'\n\nAs for `{other.program}`: {", ".join(shared)}.'
        own = [entry for entry in own if entry not in theirs]
    files = _files(f'/{node.kind.NAME}')
    head = ['parameter', 'type', 'default', 'range', 'set', 'description']
    return f'{title}\n\n{table(head, [_row(entry, files) for entry in own])}'


def _told_before(node: NodeKind, own: list[ParameterDescription]) -> NodeKind | None:
    """An earlier node that has many of the same parameters."""
    for other in node_kinds()[: node_kinds().index(node)]:
        if len(set(own) & set(params.describe(other.kind.PARAMS))) > _MANY:
            return other
    return None


def _group(entry: ParameterDescription) -> str:
    first, dot, _ = entry.name.partition('.')
    return code(f'{first}.…' if dot else first)


def _row(entry: ParameterDescription, files: Mapping[str, dict[str, object]]) -> list[str]:
    return [
        code(entry.name),
        entry.type.replace('_array', ' list'),
        '; '.join([code(written(entry.default)), *_elsewhere(entry, files)]),
        _limits(entry),
        'at start' if entry.read_only else 'any time',
        entry.description,
    ]


def _elsewhere(entry: ParameterDescription, files: Mapping[str, dict[str, object]]) -> Iterator[str]:
    """The values in parameter files that differ from the default."""
    given = {name: values[entry.name] for name, values in files.items() if entry.name in values}
    for value in dict.fromkeys(value for value in given.values() if value != entry.default):
        yield f'{code(written(value))} in {", ".join(name for name, other in given.items() if other == value)}'


def _limits(entry: ParameterDescription) -> str:
    if entry.choices:
        return ', '.join(code(written(choice)) for choice in entry.choices)
    low, high = entry.minimum, entry.maximum
    if low is not None and high is not None:
        return f'{low:g} to {high:g}'
    if low is not None:
        return f'≥ {low:g}'
    return '' if high is None else f'≤ {high:g}'


def _files(full_name: str) -> dict[str, dict[str, object]]:
    """The parameters that each file of `config/` sets for a node."""
    found = {name: params.resolve_parameters(full_name, blocks) for name, blocks in _blocks().items()}
    return {name: {key: _plain(entry.value) for key, entry in values.items()} for name, values in found.items()}


def _plain(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


@cache
def _blocks() -> dict[str, list[params.NodeParameters]]:
    """The parameter files that name nodes; those of single devices (`/**` for all nodes) are examples and left out."""
    folder = share_directory() / 'config'
    read = {file.name: params.load_parameter_file(file) for file in sorted(folder.glob('*.yaml'))}
    return {name: blocks for name, blocks in read.items() if all(block.pattern != '/**' for block in blocks)}


def _arguments(document: dict[str, list[dict[str, dict[str, object]]]]) -> Iterator[list[str]]:
    for action in document['launch']:
        if told := action.get('arg'):
            choices = [str(choice['value']) for choice in told.get('choice', [])]  # type: ignore[attr-defined]
            default = told.get('default', dataclasses.MISSING)
            yield [
                code(f'{told["name"]}:='),
                code(written(default)),
                ', '.join(map(code, choices)),
                str(told.get('description', '')),
            ]
