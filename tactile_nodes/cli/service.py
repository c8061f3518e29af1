"""``tactile service``: list and call services, with the commands and output of ``ros2 service``."""

from __future__ import annotations

import argparse
from typing import Any

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import (
    Verbs,
    completed,
    full_type,
    is_hidden,
    joined,
    positive_float,
    read_values,
    type_of_service,
)
from tactile_nodes.errors import ServiceError

DESCRIPTION = 'List and call services.'

_CALL_EXAMPLES = """\
  tactile service call /flow_features/capture_reference std_srvs/srv/Trigger
  tactile service call /some/switch std_srvs/srv/SetBool "{data: true}"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    verb = verbs.add('list', list_services, 'list the services', '  tactile service list -t\n')
    verb.add_argument('-t', '--show-types', action='store_true', help='show the types too')
    verb.add_argument('-c', '--count-services', action='store_true', help='only print how many there are')
    verb.add_argument('-a', '--include-hidden-services', '--all', action='store_true', help='list hidden ones as well')
    verb = verbs.add('call', call, 'call a service and print the response', _CALL_EXAMPLES)
    completed(verb.add_argument('service', help='a service'), completers.services)
    completed(verb.add_argument('type', help='its type, std_srvs/srv/Trigger for example'), completers.service_types)
    verb.add_argument('values', nargs='?', default='{}', help="the request's fields as YAML")
    verb.add_argument('-r', '--rate', type=positive_float, metavar='HZ', help='call repeatedly')
    verb.add_argument(
        '--timeout', type=positive_float, default=5.0, metavar='S', help='wait S seconds for the response (5)'
    )
    verb = verbs.add('type', show_type, "print a service's type", '  tactile service type /camera/get_parameters\n')
    completed(verb.add_argument('service', help='a service'), completers.services)
    verb = verbs.add('find', find, 'list the services of a type', '  tactile service find std_srvs/srv/Trigger\n')
    completed(verb.add_argument('type', help='a service type'), completers.service_types)


def list_services(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        ends = bus.graph().services()
    shown = sorted((e.name, e.type_name) for e in ends if arguments.include_hidden_services or not is_hidden(e.name))
    if arguments.count_services:
        print(len(shown))
        return 0
    for name, type_name in shown:
        print(f'{name} [{type_name}]' if arguments.show_types else name)
    return 0


def show_type(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        print(type_of_service(bus.graph(), absolute(arguments.service)))
    return 0


def find(arguments: argparse.Namespace) -> int:
    wanted = full_type(arguments.type, 'srv')
    with joined() as bus:
        found = sorted(end.name for end in bus.graph().services() if end.type_name == wanted)
    for name in found:
        print(name)
    return 0


def call(arguments: argparse.Namespace) -> int:
    from tactile_nodes import messages
    from tactile_nodes.messages.services import request_type

    service, type_name = absolute(arguments.service), full_type(arguments.type, 'srv')
    with joined() as bus:
        served = type_of_service(bus.graph(), service)
        if served != type_name:
            raise ServiceError(f'{service} is a {served}, not a {type_name}')
        request = messages.from_dict(request_type(type_name), read_values(arguments.values))
        _call_once(bus, service, type_name, request, arguments.timeout)
        next_ns = bus.clock.now_ns()
        while arguments.rate:
            next_ns = max(next_ns + round(1e9 / arguments.rate), bus.clock.now_ns())  # no burst after a pause
            bus.clock.sleep_until(next_ns)
            _call_once(bus, service, type_name, request, arguments.timeout)
    return 0


def _call_once(bus: Any, service: str, type_name: str, request: Any, timeout_s: float) -> None:
    from tactile_nodes.cli.running.text import to_python

    print(f'requester: making request: {to_python(request)}\n', flush=True)
    response = bus.call(service, type_name, request, timeout_s)
    print(f'response:\n{to_python(response)}\n', flush=True)
