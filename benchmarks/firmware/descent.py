"""The descent of each press, as in a collection: with hands, safety and guard; home, above the gel, down."""

from __future__ import annotations

from tactile_nodes.clock import Clock
from tactile_nodes.collection.actions import Go, Look, Procedure, SetTare
from tactile_nodes.collection.press.rising import rising
from tactile_nodes.collection.press.surface import HERTZ, Loading, Surface
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.collection.wrench import Tare, tare_of
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings, Place
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import DeviceError

COMMANDED_MM, ABOVE_MM = 2.0, 0.2
PRESS_MM_MIN, TRAVEL_MM_MIN = 60.0, 1200.0
SLOPE = 0.577  # slope of the loading line of the paper's gel, (N^2/3)/mm
MOST_SILENCES = 20
LIMITS = LimitSettings(force_silence_ms=300.0)


def station(cnc: CncSettings, sensor: ForceTorqueSettings, clock: Clock) -> Station:
    """Machine and sensor, with the safety. Raises as `Station`."""

    def nobody(_: object) -> None:
        """Ignore a report."""

    settings = CollectionSettings(limits=LIMITS)
    return Station(settings, cnc, sensor, WorldSettings(), clock, nobody, nobody, nobody)


def above(rig: Station, gel_mm: Place, safe_z_mm: float, clock: Clock) -> Tare:
    """Home, move to just above the gel, and measure the tare there. Raises as `Hands.run`."""
    approach(rig.cnc, gel_mm, safe_z_mm)
    rig.hands.safety.watch(clock.now_ns(), camera=False)
    return rig.hands.run(_tared())


def approach(cnc: Cnc, gel_mm: Place, safe_z_mm: float) -> None:
    """Home, then move up, sideways, and down to just above the gel. Raises as `Cnc`."""
    x, y, z = gel_mm
    cnc.home()
    for way in ({'z': safe_z_mm}, {'x': x, 'y': y}, {'z': z + ABOVE_MM}):
        _go(cnc, way)


def _go(cnc: Cnc, way: dict[str, float]) -> None:
    """Move above the gel; continue if the machine was stopped because it was silent, as on a busy computer."""
    for attempt in range(MOST_SILENCES + 1):
        try:
            cnc.move(**way, feed=TRAVEL_MM_MIN)
            cnc.wait_idle()
            return
        except DeviceError:
            if attempt == MOST_SILENCES or not cnc.health.silent:
                raise
            cnc.stop()


def down(surface_mm: float, tare: Tare) -> Procedure[None]:
    """Move into the gel; the force is compared with the gel's loading line."""
    gel = Surface(surface_mm, softest=Loading(surface_mm, SLOPE, HERTZ))
    expect = rising(gel, tare, CollectionSettings(), 0.0, 0.0)
    yield Go(z=surface_mm - COMMANDED_MM, feed_mm_min=PRESS_MM_MIN, expect=expect)


def _tared() -> Procedure[Tare]:
    tare = tare_of((yield Look(0.3)).samples)
    yield SetTare(tare)
    return tare
