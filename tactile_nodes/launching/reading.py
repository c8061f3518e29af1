"""From the YAML of a launch file to its actions; every key and type is checked before anything runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from tactile_nodes.launching.actions import (
    Action,
    Argument,
    Condition,
    Effect,
    Group,
    Include,
    Let,
    Log,
    PushNamespace,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
    Shutdown,
    Timer,
)
from tactile_nodes.launching.document import Entity, Item, actions_of, load_items, suggestion
from tactile_nodes.launching.process_actions import read_executable, read_node

ENV = 'give each process its env: [{name, value}]'
_UNSUPPORTED = {
    'composable_node': 'it loads C++ plugins; start each node as a process with the action node',
    'load_composable_node': 'it loads C++ plugins; start each node as a process with the action node',
    'node_container': 'it loads C++ plugins; start each node as a process with the action node',
    'lifecycle_node': 'use the action node',
    'lifecycle_transition': 'use the action node',
    'ros_timer': 'it needs a ROS clock; use the action timer',
    'set_ros_log_dir': 'ROS 2 Humble lacks it; set the environment variable ROS_LOG_DIR',
    'for': 'most ROS 2 distributions lack it; write the actions out',
    'for_env': 'most ROS 2 distributions lack it; write the actions out',
    'push-ros-namespace': 'ROS 2 calls it push_ros_namespace now',
    'include_scoped': 'ROS 2 Humble lacks it; put an include into a group',
    'unlet': 'ROS 2 Humble lacks it; use a scoped group',
    'append_env': ENV,
    'set_env': ENV,
    'unset_env': ENV,
    'reset_env': ENV,
    'reset': 'use a group with forwarding: false',
    'set_use_sim_time': "write set_parameter: {name: use_sim_time, value: 'true'}",
}


def read_file(file: Path) -> tuple[Action, ...]:
    """The actions of a launch file.

    Raises:
        LaunchFileError: the file cannot be read, or is not a valid launch file; with file and line.
    """
    return read_actions(load_items(file))


def read_actions(items: Sequence[tuple[str, Item]]) -> tuple[Action, ...]:
    return tuple(_read_action(name, item) for name, item in items)


def _read_action(name: str, item: Item) -> Action:
    if name in _UNSUPPORTED:
        raise item.place.error(f"the action '{name}' is not supported: {_UNSUPPORTED[name]}")
    if name not in READERS:
        raise item.place.error(f"unknown action '{name}'{suggestion(name, READERS)}")
    if name == 'group' and isinstance(item.value, list):
        item = Item({'children': item}, item.place)
    entity = Entity(name, item)
    condition = _read_condition(entity)
    effect = READERS[name](entity)
    entity.finish()
    return Action(name, entity.place, effect, condition, item)


def _read_condition(entity: Entity) -> Condition | None:
    if_text, unless_text = entity.template_or_none('if'), entity.template_or_none('unless')
    if if_text and unless_text:
        raise entity.place.error(f"{entity.kind}: 'if' and 'unless' cannot be used together")
    if if_text:
        return Condition(if_text, wanted=True)
    return Condition(unless_text, wanted=False) if unless_text else None


def _children(entity: Entity) -> tuple[Action, ...]:
    return read_actions(actions_of(entity.kind, entity.item('children')))


def _read_argument(entity: Entity) -> Argument:
    choices = entity.entities_of('choice', lambda choice: choice.text('value'))
    return Argument(
        entity.text('name'),
        entity.template_or_none('default'),
        _description(entity.text_or_none('description'), choices),
        choices,
        entity.place,
    )


def _description(text: str | None, choices: tuple[str, ...]) -> str:
    if not choices:
        return text if text is not None else 'no description given'
    if text is None:
        return f'One of: {list(choices)}'
    return f'{text if text.endswith(".") else text + "."} Valid choices are: {list(choices)}'


def _read_let(entity: Entity) -> Let:
    return Let(entity.template('name'), entity.template('value'))


def _read_timer(entity: Entity) -> Timer:
    if entity.item('period').value is None:
        raise entity.place.error("timer: 'period' expected float, got nothing")
    return Timer(
        entity.template_or('period', float, default=0.0),
        entity.template_or('cancel_on_shutdown', bool, default=True),
        _children(entity),
    )


def _read_include(entity: Entity) -> Include:
    return Include(entity.template('file'), entity.entities_of('arg', _read_let), entity.place)


def _read_group(entity: Entity) -> Group:
    return Group(
        _children(entity),
        entity.boolean('scoped', default=True),
        entity.boolean('forwarding', default=True),
        entity.entities_of('keep', _read_let),
    )


READERS: dict[str, Callable[[Entity], Effect]] = {
    'arg': _read_argument,
    'executable': read_executable,
    'group': _read_group,
    'include': _read_include,
    'let': _read_let,
    'log': lambda entity: Log(entity.template('message')),
    'node': read_node,
    'push_ros_namespace': lambda entity: PushNamespace(entity.template('namespace')),
    'set_parameter': lambda entity: SetParameter(entity.template('name'), entity.template('value')),
    'set_parameters_from_file': lambda entity: SetParametersFromFile(entity.template('filename')),
    'set_remap': lambda entity: SetRemap(entity.template('from'), entity.template('to')),
    'shutdown': lambda entity: Shutdown(entity.template_or_none('reason')),
    'timer': _read_timer,
}
