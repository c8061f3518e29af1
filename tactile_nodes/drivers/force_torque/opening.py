"""The choice of the force/torque sensor for a SOURCE; docs/force_torque.md has a table of them."""

from __future__ import annotations

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.force_torque.contract import SIMULATED, ForceTorqueSensor, ForceTorqueSettings
from tactile_nodes.errors import ConfigurationError


def open_force_torque(settings: ForceTorqueSettings, clock: Clock) -> ForceTorqueSensor:
    """The sensor of `settings.source`, open.

    Raises:
        ConfigurationError: the source is not a kind of sensor.
        DeviceError: as `ForceTorqueSensor.open`.
    """
    sensor = _sensor(settings, clock)
    try:
        sensor.open()
    except BaseException:
        sensor.close()
        raise
    return sensor


def _sensor(settings: ForceTorqueSettings, clock: Clock) -> ForceTorqueSensor:
    kind, _, rest = settings.source.strip().partition(':')
    if kind == SIMULATED:
        from tactile_nodes.drivers.force_torque.simulated import SimulatedForceTorque

        return SimulatedForceTorque(settings, clock)
    if kind == 'netft' and rest.strip('/'):
        from tactile_nodes.drivers.force_torque.net_ft import net_ft_sensor

        return net_ft_sensor(settings, clock, rest.strip('/'))
    if kind == 'bota' and rest:
        from tactile_nodes.drivers.force_torque.bota import bota_sensor

        return bota_sensor(settings, clock, _device(rest))
    if kind == 'text' and rest:
        from tactile_nodes.drivers.force_torque.text import text_line_sensor

        return text_line_sensor(settings, clock, _device(rest))
    raise ConfigurationError(
        f'{settings.source!r} is not a force/torque sensor; use simulated, netft://192.168.1.1, bota:/dev/ttyUSB0 '
        'or text:/dev/ttyUSB0'
    )


def _device(rest: str) -> str:
    return '/' + rest.lstrip('/') if rest.startswith('//') else rest
