"""The choice of the machine for a SOURCE: simulated in a given world, or a controller at a serial port."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.cnc.contract import SIMULATED, Cnc, CncSettings, Traffic
from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.drivers.cnc.simulated import Machine


def open_cnc(
    settings: CncSettings, clock: Clock, *, machine: Machine | None = None, traffic: Traffic | None = None
) -> Cnc:
    """The machine of `settings.source`, connected.

    Args:
        settings: which machine, and its allowed motion.
        clock: the host's.
        machine: the world of the simulated machine, e.g. the emulators' `World`.
        traffic: gets every byte in both directions.

    Raises:
        ConfigurationError, DeviceError: as `Cnc.connect`.
    """
    cnc = _cnc(settings, clock, machine, traffic)
    try:
        cnc.connect()
    except BaseException:
        cnc.close()
        raise
    return cnc


def _cnc(settings: CncSettings, clock: Clock, machine: Machine | None, traffic: Traffic | None) -> Cnc:
    if settings.source == SIMULATED:
        from tactile_nodes.drivers.cnc.simulated import SimulatedCnc

        if machine is None:
            raise ConfigurationError('the simulated CNC needs a simulated world; pass one, or use a serial port')
        return SimulatedCnc(settings, clock, machine)
    from tactile_nodes.drivers.cnc.grbl import GrblCnc
    from tactile_nodes.drivers.cnc.marlin import MarlinCnc
    from tactile_nodes.drivers.serial_port import open_port

    kind = MarlinCnc if settings.kind == 'marlin' else GrblCnc
    return kind(settings, clock, lambda: open_port(settings.source, settings.baud, settings.dtr, clock), traffic)
