"""``tactile node``, ``param`` and ``service`` against a running node."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from running_system import LampNode, Tactile

from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.cli.param import typed
from tactile_nodes.messages import services, types
from tactile_nodes.params import load_parameter_file, parameter_file_text, resolve_parameters


def test_nodes_are_listed(lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('node', 'list').out == '/lamp\n'
    assert tactile('node', 'list', '-c').out == '1\n'


def test_names_used_twice_are_warned_of_and_hidden_ones_listed_when_asked_for(other: ZmqBus, tactile: Tactile) -> None:
    for name in ('/_tool', '/twin', '/twin'):
        other.add_node(name)
    ended = tactile('node', 'list')
    assert ended.out == '/twin\n/twin\n'
    assert ended.err.startswith('WARNING: several nodes share a name')
    assert tactile('node', 'list', '-a').out == '/_tool\n/twin\n/twin\n'


def test_node_info_tells_ends_process_and_answer(lamp: LampNode, tactile: Tactile) -> None:
    lines = tactile('node', 'info', 'lamp').out.splitlines()
    assert lines[0] == '/lamp'
    assert '    /wrench: geometry_msgs/msg/WrenchStamped' in lines[lines.index('  Publishers:') :]
    assert '    /lamp/blink: std_srvs/srv/Trigger' in lines[lines.index('  Service Servers:') :]
    assert any(line.startswith(f'  Process: {os.getpid()} on ') for line in lines)
    assert lines[-1].startswith('  Answers: its process in ')
    assert lines[-1].endswith('and the node itself')


def test_node_info_tells_that_a_node_is_stuck(
    lamp: LampNode, tactile: Tactile, monkeypatch: pytest.MonkeyPatch
) -> None:
    free, ping = threading.Event(), ZmqBus.ping
    monkeypatch.setattr(ZmqBus, 'ping', lambda bus, uid, _: ping(bus, uid, 30.0))  # its process is only late
    lamp.post(lambda: free.wait(60) and None)
    try:
        last = tactile('node', 'info', '/lamp', '--timeout', '0.2').out.splitlines()[-1]
    finally:
        free.set()
    assert last.endswith('but the node itself did not respond within 0.2 s: it is busy or stuck')


def test_an_unknown_node_is_reported(tactile: Tactile) -> None:
    ended = tactile('node', 'info', '/nobody')
    assert (ended.status, ended.err) == (1, 'there is no node /nobody; see tactile node list\n')


def test_parameters_of_all_nodes_are_listed(lamp: LampNode, other: ZmqBus, tactile: Tactile) -> None:
    other.add_node('/camera')  # without parameters, as `topic pub -n`, or what listens to tf on ROS 2
    assert tactile('param', 'list').out == '/lamp:\n  colour\n  level\n  serial\n  steps\n  use_sim_time\n'


def test_parameters_of_one_node_are_listed_with_types(lamp: LampNode, tactile: Tactile) -> None:
    lines = tactile('param', 'list', '/lamp', '--param-type').out.splitlines()
    assert '  level (type: double)' in lines
    assert '  steps (type: integer array)' in lines


@pytest.mark.parametrize(
    ('name', 'printed'),
    [
        ('level', 'Double value is: 0.5\n'),
        ('colour', 'String value is: on\n'),
        ('use_sim_time', 'Boolean value is: False\n'),
        ('steps', 'Integer values are: [1, 2]\n'),
    ],
)
def test_a_parameter_is_read_with_its_type(name: str, printed: str, lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('param', 'get', '/lamp', name).out == printed


def test_the_type_can_be_hidden(lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('param', 'get', '/lamp', 'level', '--hide-type').out == '0.5\n'


def test_a_missing_parameter_is_reported(lamp: LampNode, tactile: Tactile) -> None:
    ended = tactile('param', 'get', '/lamp', 'levle')
    assert (ended.status, ended.err) == (1, "/lamp has no parameter 'levle'; see tactile param list\n")


def test_a_parameter_is_reported_as_missing_by_a_node_of_rclcpp(other: ZmqBus, tactile: Tactile) -> None:
    names = {'list_parameters': services.LIST_PARAMETERS, 'get_parameters': services.GET_PARAMETERS}
    for name, type_name in names.items():
        other.serve(f'/arm/{name}', type_name, lambda _, reply: reply(types.GetParameters_Response()), '/arm')
    ended = tactile('param', 'get', '/arm', 'levle')
    assert (ended.status, ended.err) == (1, "/arm has no parameter 'levle'; see tactile param list\n")


def test_a_parameter_is_changed(lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('param', 'set', '/lamp', 'level', '0.75').out == 'Set parameter successful\n'
    assert lamp.params.level == 0.75


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [('level', '7.0', 'from 0.0 to 1.0'), ('level', '1', 'write 1.0'), ('serial', 'x', 'when the node starts')],
)
def test_a_refused_change_gives_the_reason(
    name: str, value: str, reason: str, lamp: LampNode, tactile: Tactile
) -> None:
    ended = tactile('param', 'set', '/lamp', name, value)
    assert ended.status == 1
    assert ended.err.startswith('Setting parameter failed: ')
    assert reason in ended.err


def test_describe_tells_type_meaning_limits_and_what_only_a_restart_changes(lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('param', 'describe', '/lamp', 'level').out == (
        'Parameter name: level\n  Type: double\n  Description: how bright\n  Constraints:\n'
        '    Min value: 0.0\n    Max value: 1.0\n'
    )
    assert 'Read only: true' in tactile('param', 'describe', '/lamp', 'serial').out


def test_what_is_dumped_loads_as_the_same(lamp: LampNode, tactile: Tactile, tmp_path: Path) -> None:
    file = tmp_path / 'lamp.yaml'
    file.write_text(tactile('param', 'dump', '/lamp').out)
    found = {name: value.value for name, value in resolve_parameters('/lamp', load_parameter_file(file)).items()}
    assert found == {'level': 0.5, 'serial': '00012345', 'colour': 'on', 'steps': [1, 2], 'use_sim_time': False}


def test_texts_that_rcl_would_type_survive_a_dump(tmp_path: Path) -> None:
    values = {f't{number}': text for number, text in enumerate(['y', '1e-3', '0x1f', '', 'a: b', '.nan', "it's"])}
    file = tmp_path / 'p.yaml'
    file.write_text(parameter_file_text({'/n': {**values, 'deep.er': 1e-5}}))
    found = {name: value.value for name, value in resolve_parameters('/n', load_parameter_file(file)).items()}
    assert found == {**values, 'deep.er': 1e-5}


@pytest.mark.parametrize(
    ('flags', 'wildcard', 'level'),
    [((), 'Set parameter level successful\n', 0.1), (('--no-use-wildcard',), '', 0.5)],
)
def test_a_parameter_file_is_loaded_and_its_wildcards_can_be_left_out(
    lamp: LampNode, tactile: Tactile, tmp_path: Path, flags: tuple[str, ...], wildcard: str, level: float
) -> None:
    file = tmp_path / 'p.yaml'
    file.write_text('/**: {ros__parameters: {level: 0.1, for_others: 3}}\nlamp: {ros__parameters: {colour: red}}\n')
    ended = tactile('param', 'load', '/lamp', str(file), *flags)
    assert ended.status == 0
    assert ended.out == f'{wildcard}Set parameter colour successful\n'
    assert (lamp.params.level, lamp.params.colour) == (level, 'red')


def test_loading_tells_what_was_refused(lamp: LampNode, tactile: Tactile, tmp_path: Path) -> None:
    file = tmp_path / 'p.yaml'
    file.write_text('lamp: {ros__parameters: {level: 2.0, colour: red}}\n')
    ended = tactile('param', 'load', '/lamp', str(file))
    assert ended.status == 1
    assert ended.err.startswith('Set parameter level failed: ')
    assert ended.out == 'Set parameter colour successful\n'


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('7', 7), ('7.0', 7.0), ('1e-3', 0.001), ('on', True), ("'on'", 'on'), ('[1, 2]', [1, 2]), ('a: b', 'a: b'),
        ('', ''),
    ],
)  # fmt: skip
def test_values_are_typed_as_in_a_parameter_file(text: str, value: object) -> None:
    found = typed(text)
    assert (found, type(found)) == (value, type(value))


def test_services_are_listed_with_types(lamp: LampNode, tactile: Tactile) -> None:
    assert '/lamp/blink [std_srvs/srv/Trigger]\n' in tactile('service', 'list', '-t').out
    assert tactile('service', 'type', '/lamp/blink').out == 'std_srvs/srv/Trigger\n'
    assert tactile('service', 'find', 'std_srvs/Trigger').out == '/lamp/blink\n'


def test_a_service_is_called(lamp: LampNode, tactile: Tactile) -> None:
    assert tactile('service', 'call', 'lamp/blink', 'std_srvs/Trigger').out == (
        'requester: making request: std_srvs.srv.Trigger_Request()\n\n'
        "response:\nstd_srvs.srv.Trigger_Response(success=True, message='blinked')\n\n"
    )


@pytest.mark.parametrize(
    ('words', 'error'),
    [
        (('/nothing', 'std_srvs/srv/Trigger'), 'no node offers the service /nothing'),
        (('/lamp/blink', 'std_srvs/srv/SetBool'), '/lamp/blink is a std_srvs/srv/Trigger, not a std_srvs/srv/SetBool'),
        (('/lamp/blink', 'std_srvs/srv/Tricker'), '/lamp/blink is a std_srvs/srv/Trigger, not a std_srvs/srv/Tricker'),
        (('/lamp/blink', 'std_srvs/srv/Trigger', '{data: 1}'), "has no field 'data'"),
    ],
)
def test_a_wrong_call_is_reported_in_one_line(
    words: tuple[str, ...], error: str, lamp: LampNode, tactile: Tactile
) -> None:
    ended = tactile('service', 'call', *words)
    assert (ended.status, ended.out) == (1, '')
    assert error in ended.err
    assert ended.err.count('\n') == 1
