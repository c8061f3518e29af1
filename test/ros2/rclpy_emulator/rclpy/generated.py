"""Classes as rosidl_generator_py makes them, for the types that the package knows: ``std_msgs.msg.Int64``, say."""

from __future__ import annotations

import dataclasses
import importlib.abc
import importlib.machinery
import sys
import types
from typing import Any

import numpy as np

from tactile_nodes import messages
from tactile_nodes.messages.services import SERVICES
from tactile_nodes.messages.store import store

_EMPTY = 'structure_needs_at_least_one_member'


class Generated:
    """A message with fields that can be assigned; keywords only."""

    __msgtype__ = ''

    def __init__(self, **values: Any) -> None:
        ours = messages.message_class(self.__msgtype__)()
        for field in dataclasses.fields(ours):
            if field.name != _EMPTY:
                setattr(self, field.name, theirs(values.pop(field.name, getattr(ours, field.name))))
        assert not values, f'Invalid arguments passed to constructor: {sorted(values)}'


def generated_class(name: str) -> type[Generated]:
    """The class of the message type `name`."""
    messages.message_class(name)
    if name not in _CLASSES:
        _CLASSES[name] = type(name.rpartition('/')[2], (Generated,), {'__msgtype__': name})
    return _CLASSES[name]


def theirs(value: Any) -> Any:
    """A value of our classes as rclpy holds it."""
    if dataclasses.is_dataclass(value):
        made = generated_class(messages.type_name(value))()
        for field in dataclasses.fields(value):
            if field.name != _EMPTY:
                setattr(made, field.name, theirs(getattr(value, field.name)))
        return made
    return [theirs(item) for item in value] if isinstance(value, list) else value


def ours(value: Any) -> Any:
    """The reverse; a numpy number in a field, which ends a process of rclpy's, fails."""
    assert not isinstance(value, np.generic), f'{value!r} would abort in the converter to C'
    if isinstance(value, Generated):
        fields = {name: ours(content) for name, content in vars(value).items()}
        return messages.message_class(value.__msgtype__)(**fields)
    return [ours(item) for item in value] if isinstance(value, list) else value


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds ``<package>.msg`` and ``<package>.srv`` of every package that the store knows."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        del path, target
        package, _, kind = fullname.partition('.')
        if package not in _packages() or kind not in {'', 'msg', 'srv'} or (package == 'tactile_nodes' and not kind):
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=not kind)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType | None:
        return None

    def exec_module(self, module: types.ModuleType) -> None:
        package, _, kind = module.__name__.partition('.')
        for name in [*store().fielddefs, *SERVICES]:
            its, kind_of_it, short = name.split('/')
            if its != package or kind_of_it != kind:
                continue
            if kind == 'msg':
                setattr(module, short, generated_class(name))
            elif short.endswith('_Request'):
                service = short.removesuffix('_Request')
                halves = {half: generated_class(f'{its}/srv/{service}_{half}') for half in ('Request', 'Response')}
                setattr(module, service, type(service, (), {'__msgtype__': f'{its}/srv/{service}', **halves}))


_CLASSES: dict[str, type[Generated]] = {}
_FINDER = _Finder()


def _packages() -> set[str]:
    return {name.split('/')[0] for name in store().fielddefs}


def install() -> None:
    """Let the generated packages be imported."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.append(_FINDER)


def remove() -> None:
    """Take that back."""
    if _FINDER in sys.meta_path:
        sys.meta_path.remove(_FINDER)
    for name, module in list(sys.modules.items()):
        if getattr(module, '__loader__', None) is _FINDER:
            del sys.modules[name]
