"""``tactile param``: the nodes' parameters, with the commands and output of ``ros2 param``."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import Verbs, completed, is_hidden, joined
from tactile_nodes.errors import BusError, ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.bus.node.parameter_client import ParameterClient
    from tactile_nodes.messages import types
    from tactile_nodes.params import Located, Value

DESCRIPTION = "List, read, change, describe, save and load the nodes' parameters."

_KINDS = ('not set', 'boolean', 'integer', 'double', 'string')
_LIST = '/list_parameters'
_TYPE_TEXTS = (*_KINDS, 'byte array', *(f'{kind} array' for kind in _KINDS[1:]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    _add_list(verbs)
    verb = _add_with_node(verbs, 'get', get, "print a parameter's value", '  tactile param get /camera rate\n')
    _add_name(verb, 'name')
    verb.add_argument('--hide-type', action='store_true', help='print the value alone')
    verb = _add_with_node(verbs, 'set', set_value, 'change a parameter', _SET_EXAMPLES)
    _add_name(verb, 'name')
    verb.add_argument('value', help='the new value, written as in a parameter file (7.0 and 7 differ)')
    verb = _add_with_node(verbs, 'describe', describe, 'describe parameters', _DESCRIBE_EXAMPLES)
    _add_name(verb, 'names', nargs='*')
    _add_with_node(verbs, 'dump', dump, "print a node's parameters as a parameter file", _DUMP_EXAMPLES)
    verb = _add_with_node(
        verbs, 'load', load, 'set the parameters in a parameter file', '  tactile param load /camera a.yaml\n'
    )
    verb.add_argument('file', help='a parameter file')
    verb.add_argument('--no-use-wildcard', action='store_true', help="leave out entries for '/**'")


_SET_EXAMPLES = """\
  tactile param set /force_estimator least_confidence 0.8
  tactile param set /recorder bag "'7'"            a string, although it looks like a number
"""
_DESCRIBE_EXAMPLES = '  tactile param describe /camera rate\n  tactile param describe /camera            all of them\n'
_DUMP_EXAMPLES = '  tactile param dump /camera > camera.yaml\n'


def _add_list(verbs: Verbs) -> None:
    verb = verbs.add('list', list_all, 'list the parameters of one node, or of all', '  tactile param list /camera\n')
    completed(
        verb.add_argument('node', nargs='?', type=_full_name, help='a node (default: all nodes)'), completers.nodes
    )
    verb.add_argument('-a', '--all', action='store_true', help='include hidden nodes')
    verb.add_argument(
        '--param-prefixes', nargs='+', default=[], metavar='PREFIX', help='only PREFIX and those below it: PREFIX.…'
    )
    verb.add_argument('--param-type', action='store_true', help='print the type of each')


def _full_name(node: str) -> str:
    return absolute(node, 'a node')


def _add_with_node(verbs: Verbs, name: str, action: Any, line: str, examples: str) -> argparse.ArgumentParser:
    verb = verbs.add(name, action, line, examples)
    completed(verb.add_argument('node', type=_full_name, help='a node, /camera for example'), completers.nodes)
    return verb


def _add_name(parser: argparse.ArgumentParser, name: str, nargs: str | None = None) -> None:
    completed(parser.add_argument(name, nargs=nargs, help='name of a parameter'), completers.parameters)


def list_all(arguments: argparse.Namespace) -> int:
    status = 0
    with joined() as bus:
        names = {end.name for end in bus.graph().services() if end.name.endswith(_LIST)}
        nodes = sorted(name.removesuffix(_LIST) for name in names if arguments.all or not is_hidden(name))
        for node in [arguments.node] if arguments.node else nodes:
            try:
                lines = _listed(_client(bus, node), arguments)
            except BusError as error:
                print(error, file=sys.stderr)
                status = 1
                continue
            print('\n'.join(lines if arguments.node else [f'{node}:', *lines]))
    return status


def _listed(client: ParameterClient, arguments: argparse.Namespace) -> list[str]:
    names = client.names(arguments.param_prefixes)
    if not arguments.param_type:
        return [f'  {name}' for name in names]
    return [f'  {found.name} (type: {_TYPE_TEXTS[found.type]})' for found in client.descriptors(names)]


def get(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        value = _client(bus, arguments.node).values([arguments.name])[arguments.name]
    if value is None:
        raise ConfigurationError(f'{arguments.node} has no parameter {arguments.name!r}; see tactile param list')
    print(value if arguments.hide_type else f'{_label(value)} {value}')
    return 0


def _label(value: Value) -> str:
    many = isinstance(value, list)
    one = next(iter(value), '') if isinstance(value, list) else value
    kind = _KINDS[{bool: 1, int: 2, float: 3}.get(type(one), 4)]
    return f'{kind.capitalize()} {"values are" if many else "value is"}:'


def set_value(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        client = _client(bus, arguments.node)
        try:
            client.set(arguments.name, typed(arguments.value))
        except ConfigurationError as error:
            print(f'Setting parameter failed: {error}', file=sys.stderr)
            return 1
    print('Set parameter successful')
    return 0


def typed(text: str) -> Value:
    """A value as in a parameter file; any text that is not such a value is a string.

    >>> typed('7'), typed('7.0'), typed('1e-3'), typed("'7'"), typed('[1, 2]'), typed('a: b')
    (7, 7.0, 0.001, '7', [1, 2], 'a: b')
    """
    from tactile_nodes.params import parse_parameters

    try:
        blocks = parse_parameters(f'_: {{ros__parameters: {{v: {text}}}}}', text)
    except ConfigurationError:
        return text
    values = blocks[0].values if len(blocks) == 1 else {}
    return values['v'].value if values.keys() == {'v'} else text


def describe(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        client = _client(bus, arguments.node)
        names = client.names()
        for name in arguments.names:
            if name not in names:
                raise ConfigurationError(f'{arguments.node} has no parameter {name!r}; see tactile param list')
        for found in client.descriptors(arguments.names or names):
            print('\n'.join(_description(found)))
    return 0


def _description(found: types.ParameterDescriptor) -> list[str]:
    lines = [f'Parameter name: {found.name}', f'  Type: {_TYPE_TEXTS[found.type]}']
    if found.description:
        lines.append(f'  Description: {found.description}')
    lines.append('  Constraints:')
    if found.read_only:
        lines.append('    Read only: true')
    ranges: list[Any] = [*found.floating_point_range, *found.integer_range]
    for bounds in ranges:
        lines += [f'    Min value: {bounds.from_value}', f'    Max value: {bounds.to_value}']
    if found.additional_constraints:
        lines.append(f'    Additional constraints: {found.additional_constraints}')
    return lines


def dump(arguments: argparse.Namespace) -> int:
    from tactile_nodes.params import parameter_file_text

    with joined() as bus:
        client = _client(bus, arguments.node)
        values = client.values(client.names())
    print(parameter_file_text({arguments.node: dict(sorted(values.items()))}), end='')
    return 0


def load(arguments: argparse.Namespace) -> int:
    from tactile_nodes.params import exact_names, load_parameter_file, resolve_parameters

    node, blocks = arguments.node, load_parameter_file(arguments.file)
    if arguments.no_use_wildcard:
        blocks = [block for block in blocks if '*' not in block.pattern]
    values = resolve_parameters(node, blocks)
    if not values:
        raise ConfigurationError(f'{arguments.file} holds no parameters for {node}')
    with joined() as bus:
        client = _client(bus, node)
        # Wildcard entries for parameters that it does not have are ignored.
        wanted = exact_names(node, blocks) | set(client.names())
        return max([0, *(_load_one(client, name, value) for name, value in values.items() if name in wanted)])


def _load_one(client: ParameterClient, name: str, written: Located) -> int:
    try:
        client.set(name, written.value)
    except ConfigurationError as error:
        print(f'Set parameter {name} failed: {error}', file=sys.stderr)
        return 1
    print(f'Set parameter {name} successful')
    return 0


def _client(bus: Any, node: str) -> ParameterClient:
    from tactile_nodes.bus.node.parameter_client import ParameterClient

    return ParameterClient(bus, node)
