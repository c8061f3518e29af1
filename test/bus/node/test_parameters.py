"""Parameters of a node, asked for and set by others: inside a process and over the wire."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.parameters import ParameterServer, from_message, to_message
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import services, types
from tactile_nodes.params import parameter


@dataclass(frozen=True)
class Lens:
    focal: float = parameter(1.5, 'focal length [mm]', minimum=0.1)


@dataclass(frozen=True)
class Params(NodeParams):
    rate: float = parameter(60.0, 'frames per second', minimum=1.0, maximum=240.0)
    count: int = parameter(3, 'how many', minimum=1, maximum=9)
    preset: str = parameter('medium', 'which', choices=('fast', 'medium'))
    enabled: bool = parameter(True, 'whether')
    crop: tuple[int, ...] = parameter((), 'a list of numbers')
    serial: str = parameter('1', 'fixed', read_only=True)
    lens: Lens = Lens()


class Tunable(Node):
    NAME = 'tunable'
    PARAMS = Params

    def on_parameters(self, changed: Params) -> None:
        if changed.rate == 13.0:
            raise ConfigurationError('13 brings bad luck')


@pytest.fixture
def ask(join: Callable[..., ZmqBus], spinning: Callable[[Node], Node]) -> Callable[[str, Any], Any]:
    """Calls one of the node's parameter services from another participant, over the wire."""
    spinning(Tunable(join()))
    client = join()
    kinds = {'list': services.LIST_PARAMETERS, 'get': services.GET_PARAMETERS, 'set': services.SET_PARAMETERS}
    kinds['describe'] = services.DESCRIBE_PARAMETERS
    return lambda verb, request: client.call(f'/tunable/{verb}_parameters', kinds[verb], request)


def _set(ask: Callable[[str, Any], Any], name: str, value: Any) -> Any:
    message = value if isinstance(value, types.ParameterValue) else to_message(value)
    request = types.SetParameters_Request(parameters=[types.Parameter(name=name, value=message)])
    (result,) = ask('set', request).results
    return result


def _get(ask: Callable[[str, Any], Any], *names: str) -> list[Any]:
    return [from_message(value) for value in ask('get', types.GetParameters_Request(names=list(names))).values]


def test_list_names_all_and_the_prefixes_of_nested_ones(ask: Callable[[str, Any], Any]) -> None:
    result = ask('list', types.ListParameters_Request()).result
    assert result.names == ['use_sim_time', 'rate', 'count', 'preset', 'enabled', 'crop', 'serial', 'lens.focal']
    assert result.prefixes == ['lens']


@pytest.mark.parametrize(
    ('prefixes', 'depth', 'names'),
    [(['lens'], 0, ['lens.focal']), (['rate', 'ra'], 0, ['rate']), ([], 1, 7), (['nothing'], 0, [])],
)
def test_list_keeps_to_prefixes_and_depth(
    ask: Callable[[str, Any], Any], prefixes: list[str], depth: int, names: list[str] | int
) -> None:
    found = ask('list', types.ListParameters_Request(prefixes=prefixes, depth=depth)).result.names
    assert (len(found) if isinstance(names, int) else found) == names


def test_get_gives_each_type_and_not_set_for_what_is_unknown(ask: Callable[[str, Any], Any]) -> None:
    names = ['rate', 'count', 'preset', 'enabled', 'lens.focal', 'nothing']
    assert _get(ask, *names) == [60.0, 3, 'medium', True, 1.5, None]


def test_empty_list_keeps_its_declared_type(ask: Callable[[str, Any], Any]) -> None:
    (value,) = ask('get', types.GetParameters_Request(names=['crop'])).values
    assert value.type == 7  # PARAMETER_INTEGER_ARRAY of rcl_interfaces/msg/ParameterType


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('rate', 30.0), ('count', 9), ('preset', 'fast'), ('enabled', False), ('lens.focal', 2.0), ('crop', [440, 400]),
    ],
)  # fmt: skip
def test_set_value_is_the_one_that_get_gives(ask: Callable[[str, Any], Any], name: str, value: Any) -> None:
    assert _set(ask, name, value).successful
    assert _get(ask, name) == [value]


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('rate', 241.0, "'rate' must be from 1.0 to 240.0, got 241.0"),
        ('rate', math.nan, "'rate' must be a number, got nan"),
        ('rate', 30, "'rate' must be a float, got 30 (int); write 30.0"),
        ('rate', 13.0, '13 brings bad luck'),
        ('preset', 'slow', "'preset' must be one of 'fast', 'medium', got 'slow'"),
        ('serial', '2', "'serial' can only be set when the node starts"),
        ('ratee', 1.0, "unknown parameter 'ratee'; available:"),
        ('count', types.ParameterValue(), "'count' must be a int, got None"),
        ('crop', [1.5], "'crop' must be a int"),
    ],
)
def test_value_that_does_not_fit_is_refused_with_the_reason_and_changes_nothing(
    ask: Callable[[str, Any], Any], name: str, value: Any, reason: str
) -> None:
    before = _get(ask, 'rate', 'count', 'preset', 'serial', 'crop')
    result = _set(ask, name, value)
    assert not result.successful
    assert reason in result.reason
    assert _get(ask, 'rate', 'count', 'preset', 'serial', 'crop') == before


def test_all_values_can_be_set_as_they_are(ask: Callable[[str, Any], Any]) -> None:
    """As when what `param dump` wrote is loaded; one that only a restart can change is among them."""
    names = ask('list', types.ListParameters_Request()).result.names
    values = ask('get', types.GetParameters_Request(names=names)).values
    assert all(_set(ask, name, value).successful for name, value in zip(names, values, strict=True))


def test_description_carries_type_range_choices_and_read_only(ask: Callable[[str, Any], Any]) -> None:
    request = types.DescribeParameters_Request(names=['rate', 'count', 'lens.focal', 'preset', 'serial', 'nothing'])
    rate, count, focal, preset, serial, nothing = ask('describe', request).descriptors
    assert (rate.type, rate.description) == (3, 'frames per second')  # PARAMETER_DOUBLE
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (1.0, 240.0)
    assert (count.integer_range[0].from_value, count.integer_range[0].to_value) == (1, 9)
    assert (focal.floating_point_range[0].from_value, focal.floating_point_range[0].to_value) == (0.1, math.inf)
    assert preset.additional_constraints == 'one of fast, medium'
    assert serial.read_only
    assert (nothing.name, nothing.type) == ('nothing', 0)


def test_several_changes_take_effect_together_or_not_at_all() -> None:
    server = ParameterServer(Params(), lambda changed: None)
    with pytest.raises(ConfigurationError):
        server.change({'rate': 30.0, 'count': 100})
    assert server.block == Params()
    server.change({'rate': 30.0, 'count': 5})
    assert (server.block.rate, server.block.count) == (30.0, 5)


@pytest.mark.parametrize('value', [True, 7, -1.5, 'text', [True, False], [1, 2], [1.0, 2.0], ['a', 'b'], []])
def test_value_survives_the_round_trip_through_its_message(value: Any) -> None:
    found = from_message(to_message(value))
    assert found == value
    assert not isinstance(found, np.ndarray)
