"""Reads configuration: a block of YAML becomes a frozen dataclass, or an error that names file, line and key.

Parameter files are ROS 2's (``ros__parameters``), read by rcl's rules, so that ROS 2 can use the same file. The rules
that differ from plain YAML: ``010`` is eight, ``1e-3`` is a number, ``yes`` is true, and a list holds one type. If
several blocks match a node, their order of first appearance decides which wins, not how specific they are.

A block is declared as a frozen dataclass of `parameter()` fields::

    @dataclass(frozen=True)
    class FlowParams:
        '''Parameters of the flow node.'''
        threads: int = parameter(1, 'threads of the flow method', minimum=1)

An integer given for a `float` is refused, as in rclpy: write ``7.0``.
"""

from tactile_nodes.params.blocks import ParameterDescription, describe, from_mapping, parameter, to_values
from tactile_nodes.params.files import (
    Located,
    NodeParameters,
    Scalar,
    Value,
    compose,
    exact_names,
    load_listed,
    load_mapping,
    load_parameter_file,
    matches,
    normal_pattern,
    parameter_file_text,
    parse_parameters,
    parse_scalar,
    parse_value,
    resolve_parameters,
)

__all__ = [
    'Located', 'NodeParameters', 'ParameterDescription', 'Scalar', 'Value', 'compose', 'describe', 'exact_names',
    'from_mapping', 'load_listed', 'load_mapping', 'load_parameter_file', 'matches', 'normal_pattern', 'parameter',
    'parameter_file_text', 'parse_parameters', 'parse_scalar', 'parse_value', 'resolve_parameters', 'to_values',
]  # fmt: skip
