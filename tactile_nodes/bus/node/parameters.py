"""A node's parameters as others see them: rcl_interfaces' services on a block of `params.py`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from tactile_nodes import params
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import services, types

NOT_SET, BOOL, INTEGER, DOUBLE, STRING, BYTES, BOOLS, INTEGERS, DOUBLES, STRINGS = range(10)
_FIELDS = {
    BOOL: 'bool_value',
    INTEGER: 'integer_value',
    DOUBLE: 'double_value',
    STRING: 'string_value',
    BYTES: 'byte_array_value',
    BOOLS: 'bool_array_value',
    INTEGERS: 'integer_array_value',
    DOUBLES: 'double_array_value',
    STRINGS: 'string_array_value',
}
_KINDS = {bool: BOOL, int: INTEGER, float: DOUBLE, str: STRING}
_DTYPES = {BOOLS: np.bool_, INTEGERS: np.int64, DOUBLES: np.float64}
_KIND_BY_TYPE_NAME = {
    **{kind.__name__: number for kind, number in _KINDS.items()},
    **{f'{kind.__name__}_array': number + 5 for kind, number in _KINDS.items()},
}


class ParameterServer:
    """Lists, gives, changes and describes the parameters of one block.

    `apply` is called with the whole new block before it takes effect and may refuse it with a ConfigurationError.
    `fixed` are more parameters, each with its value as default, that only a restart can change.
    """

    def __init__(
        self, block: Any, apply: Callable[[Any], None], fixed: Iterable[params.ParameterDescription] = ()
    ) -> None:
        self.block = block
        self._apply = apply
        self._fixed = {entry.name: entry.default for entry in fixed}
        self._descriptions = {entry.name: entry for entry in (*params.describe(type(block)), *fixed)}

    def answers(self) -> dict[str, tuple[str, Callable[[Any], Any]]]:
        """The six services that every client of ROS 2 waits for before it asks: name -> type, what answers."""
        return {
            'list_parameters': (services.LIST_PARAMETERS, self.list),
            'get_parameters': (services.GET_PARAMETERS, self.get),
            'get_parameter_types': (services.GET_PARAMETER_TYPES, self.kinds),
            'describe_parameters': (services.DESCRIBE_PARAMETERS, self.describe),
            'set_parameters': (services.SET_PARAMETERS, self.set),
            'set_parameters_atomically': (services.SET_PARAMETERS_ATOMICALLY, self.set_together),
        }

    def list(self, request: types.ListParameters_Request) -> types.ListParameters_Response:
        wanted = [name for name in self._descriptions if _listed(name, request.prefixes, request.depth)]
        prefixes = sorted({name.rpartition('.')[0] for name in wanted if '.' in name})
        result = types.ListParametersResult(names=wanted, prefixes=prefixes)
        return types.ListParameters_Response(result=result)

    def get(self, request: types.GetParameters_Request) -> types.GetParameters_Response:
        values = {**params.to_values(self.block), **self._fixed}
        found = [
            self._value(name, values[name]) if name in values else types.ParameterValue() for name in request.names
        ]
        return types.GetParameters_Response(values=found)

    def set(self, request: types.SetParameters_Request) -> types.SetParameters_Response:
        results = [self._set({entry.name: from_message(entry.value)}) for entry in request.parameters]
        return types.SetParameters_Response(results=results)

    def set_together(self, request: types.SetParametersAtomically_Request) -> types.SetParametersAtomically_Response:
        values = {entry.name: from_message(entry.value) for entry in request.parameters}
        return types.SetParametersAtomically_Response(result=self._set(values))

    def kinds(self, request: types.GetParameterTypes_Request) -> types.GetParameterTypes_Response:
        descriptions = self._descriptions
        found = [
            _KIND_BY_TYPE_NAME[descriptions[name].type] if name in descriptions else NOT_SET for name in request.names
        ]
        return types.GetParameterTypes_Response(types=np.array(found, np.uint8))

    def describe(self, request: types.DescribeParameters_Request) -> types.DescribeParameters_Response:
        found = [self._descriptor(name) for name in request.names]
        return types.DescribeParameters_Response(descriptors=found)

    def change(self, values: Mapping[str, object]) -> None:
        """Set several parameters at once, or none of them.

        Raises:
            ConfigurationError: an unknown name, a value that does not fit, another value of a parameter that only a
                restart can change, or the node refuses.
        """
        now = params.to_values(self.block)
        fixed = {name: value for name, value in {**now, **self._fixed}.items() if self._descriptions[name].read_only}
        if other := [name for name in values if name in fixed and values[name] != fixed[name]]:
            raise ConfigurationError(f'{other[0]!r} can only be set when the node starts')
        wanted = {name: value for name, value in values.items() if name not in fixed}
        changed = params.from_mapping(type(self.block), {**now, **wanted}, source='set')
        self._apply(changed)
        self.block = changed

    def _value(self, name: str, value: object) -> types.ParameterValue:
        return to_message(value, _KIND_BY_TYPE_NAME[self._descriptions[name].type])

    def _set(self, values: Mapping[str, object]) -> types.SetParametersResult:
        try:
            self.change(values)
        except ConfigurationError as error:
            return types.SetParametersResult(successful=False, reason=str(error))
        return types.SetParametersResult(successful=True)

    def _descriptor(self, name: str) -> types.ParameterDescriptor:
        if name not in self._descriptions:
            return types.ParameterDescriptor(name=name)
        entry = self._descriptions[name]
        kind = _KIND_BY_TYPE_NAME[entry.type]
        return types.ParameterDescriptor(
            name=name,
            type=kind,
            description=entry.description,
            additional_constraints=f'one of {", ".join(map(str, entry.choices))}' if entry.choices else '',
            read_only=entry.read_only,
            **_ranges(kind, entry.minimum, entry.maximum),
        )


def to_message(value: Any, kind: int | None = None) -> types.ParameterValue:
    """A value as rcl_interfaces/ParameterValue; `kind` says what an empty list is a list of."""
    kind = _kind_of(value) if kind is None else kind
    content: Any = np.array(value, _DTYPES[kind]) if kind in _DTYPES else value
    fields: dict[str, Any] = {_FIELDS[kind]: content}
    return types.ParameterValue(type=kind, **fields)


def from_message(message: types.ParameterValue) -> Any:
    """The reverse; None when it is not set."""
    if message.type not in _FIELDS:
        return None
    value = getattr(message, _FIELDS[message.type])
    return value.tolist() if isinstance(value, np.ndarray) else value


def _kind_of(value: Any) -> int:
    if not isinstance(value, list):
        return _KINDS[type(value)]
    return _KINDS[type(value[0])] + 5 if value else STRINGS


def _ranges(kind: int, minimum: float | None, maximum: float | None) -> dict[str, Any]:
    if minimum is None and maximum is None:
        return {}
    if kind in {INTEGER, INTEGERS}:
        low = -(2**63) if minimum is None else int(minimum)
        high = 2**63 - 1 if maximum is None else int(maximum)
        return {'integer_range': [types.IntegerRange(from_value=low, to_value=high, step=0)]}
    low_f = -np.inf if minimum is None else float(minimum)
    high_f = np.inf if maximum is None else float(maximum)
    return {'floating_point_range': [types.FloatingPointRange(from_value=low_f, to_value=high_f, step=0.0)]}


def _listed(name: str, prefixes: list[str], depth: int) -> bool:
    """Whether `name` is, or is at most `depth` levels below, one of `prefixes` (the root if none; depth 0: any)."""
    for prefix in prefixes or ['']:
        below = name.removeprefix(f'{prefix}.') if prefix else name
        if name == prefix or ((below != name or not prefix) and (depth == 0 or below.count('.') < depth)):
            return True
    return False
