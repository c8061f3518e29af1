"""The quality of service of single topics as parameters, named as rclpy names them.

``qos_overrides./skin/image_raw.publisher.reliability: best_effort`` in a parameter file; the topic's full name, after
namespace and remaps. All are read when the node starts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import Located, ParameterDescription, Value

PREFIX = 'qos_overrides.'
Entity = Literal['publisher', 'subscription']
_CHOICES: dict[str, tuple[Value, ...]] = {
    'history': ('keep_last',),
    'reliability': ('reliable', 'best_effort'),
    'durability': ('volatile', 'transient_local'),
}
_DEEPEST = 2**31 - 1  # an int of C
_POLICIES = ('depth', *_CHOICES)


class QosOverrides:
    """What the parameters of one node say of the topics that it publishes and subscribes.

    Raises:
        ConfigurationError: an unknown entity or policy, or a value that a policy does not have.
    """

    def __init__(self, values: Mapping[str, Located]) -> None:
        self.values: dict[str, Value] = {name: value.value for name, value in values.items()}
        for name, located in values.items():
            if problem := _problem(name, located.value):
                raise ConfigurationError.at(located.source, located.line, f'{name!r} {problem}')

    def of(self, entity: Entity, topic: str, qos: Qos) -> Qos:
        """`qos` with what was set for this end of the topic of this full name."""
        policies = {policy: self.values.get(f'{PREFIX}{topic}.{entity}.{policy}') for policy in _POLICIES}
        changes: dict[str, Any] = {}
        if policies['depth'] is not None:
            changes['depth'] = policies['depth']
        if policies['reliability'] is not None:
            changes['reliable'] = policies['reliability'] == 'reliable'
        if policies['durability'] is not None:
            changes['latched'] = policies['durability'] == 'transient_local'
        return replace(qos, **changes)

    def descriptions(self) -> list[ParameterDescription]:
        """Each as a parameter that only a restart can change."""
        return [
            ParameterDescription(name, type(value).__name__, value, 'quality of service', None, None, None, True)
            for name, value in self.values.items()
        ]


def _problem(name: str, value: object) -> str:
    topic, entity, policy = ([''] * 3 + name.removeprefix(PREFIX).rsplit('.', 2))[-3:]
    if not topic.startswith('/') or entity not in {'publisher', 'subscription'}:
        return "is not of the form 'qos_overrides./topic.publisher.depth' (or subscription), with the full name"
    if policy not in _POLICIES:
        return f'is not a policy that can be set; available: {", ".join(_POLICIES)}'
    if policy == 'depth':
        fits = isinstance(value, int) and not isinstance(value, bool) and 0 < value <= _DEEPEST
        return '' if fits else f'must be an integer from 1 to {_DEEPEST}'
    return '' if value in _CHOICES[policy] else f'must be {" or ".join(map(str, _CHOICES[policy]))}, got {value!r}'
