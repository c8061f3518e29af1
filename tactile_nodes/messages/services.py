"""The standard services of the nodes, as pairs of messages.

A service ``pkg/srv/Name`` is sent as its request ``pkg/srv/Name_Request`` and its response ``pkg/srv/Name_Response``,
the names of ROS 2. Their fields are those of std_srvs and rcl_interfaces.
"""

from __future__ import annotations

TRIGGER = 'std_srvs/srv/Trigger'
SET_BOOL = 'std_srvs/srv/SetBool'
LIST_PARAMETERS = 'rcl_interfaces/srv/ListParameters'
GET_PARAMETERS = 'rcl_interfaces/srv/GetParameters'
SET_PARAMETERS = 'rcl_interfaces/srv/SetParameters'
DESCRIBE_PARAMETERS = 'rcl_interfaces/srv/DescribeParameters'
GET_PARAMETER_TYPES = 'rcl_interfaces/srv/GetParameterTypes'
SET_PARAMETERS_ATOMICALLY = 'rcl_interfaces/srv/SetParametersAtomically'

SERVICES = {
    f'{TRIGGER}_Request': '',
    f'{TRIGGER}_Response': 'bool success\nstring message\n',
    f'{SET_BOOL}_Request': 'bool data\n',
    f'{SET_BOOL}_Response': 'bool success\nstring message\n',
    f'{LIST_PARAMETERS}_Request': 'string[] prefixes\nuint64 depth\n',
    f'{LIST_PARAMETERS}_Response': 'rcl_interfaces/ListParametersResult result\n',
    f'{GET_PARAMETERS}_Request': 'string[] names\n',
    f'{GET_PARAMETERS}_Response': 'rcl_interfaces/ParameterValue[] values\n',
    f'{SET_PARAMETERS}_Request': 'rcl_interfaces/Parameter[] parameters\n',
    f'{SET_PARAMETERS}_Response': 'rcl_interfaces/SetParametersResult[] results\n',
    f'{DESCRIBE_PARAMETERS}_Request': 'string[] names\n',
    f'{DESCRIBE_PARAMETERS}_Response': 'rcl_interfaces/ParameterDescriptor[] descriptors\n',
    f'{GET_PARAMETER_TYPES}_Request': 'string[] names\n',
    f'{GET_PARAMETER_TYPES}_Response': 'uint8[] types\n',
    f'{SET_PARAMETERS_ATOMICALLY}_Request': 'rcl_interfaces/Parameter[] parameters\n',
    f'{SET_PARAMETERS_ATOMICALLY}_Response': 'rcl_interfaces/SetParametersResult result\n',
}


def request_type(service: str) -> str:
    """The message type of a service's request: ``std_srvs/srv/Trigger_Request``."""
    return f'{service}_Request'


def response_type(service: str) -> str:
    return f'{service}_Response'
