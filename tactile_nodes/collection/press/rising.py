"""Checks on the way down that the force rises as expected; else sensor, tip or machine is at fault.

The expected force comes from the loading lines measured during the surface search (`surface`). They continue by Hertz
(F ~ depth^1.5), or linearly for a flat punch. On the simulated gels, 0.1 to 2.2 mm deep, the force is 0.68 to 1.5 times
the expected one. If the gel settles (viscoelastic), it is larger on a fast way down than in the slow steps of the
search. A sensor stuck at the force of 0.3 mm reads half of the expected force at 0.48 mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from tactile_nodes.collection.press.surface import Surface
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare, pressing_n, wrenches
from tactile_nodes.drivers.cnc.contract import Place
from tactile_nodes.drivers.force_torque.contract import Sample

SIGMAS = 5.0
Expect = Callable[[Place, Sequence[Sample]], str]
"""Called on the way with an earlier position and the samples since: the reason to stop; empty: continue."""


def rising(surface: Surface, tare: Tare, settings: CollectionSettings, x_mm: float, y_mm: float) -> Expect:
    """The check for the way down at a place of the gel; no check before its stiffness is known.

    The surface may be deeper by `surface.flat_mm` than it was found. The force must be at least `limits.least_share` of
    that of the softest corner, minus the contact threshold. The samples since a position never have too small a force
    for its depth, because the tip has gone deeper since.
    """

    def expect(place: Place, samples: Sequence[Sample]) -> str:
        depth_mm = surface.depth_mm(x_mm, y_mm, place[2])
        gave_n = surface.force_n(depth_mm - settings.surface.flat_mm)
        felt_n = float(pressing_n(wrenches(samples), tare, settings.mounting).mean())
        spare_n = settings.surface.least_n + SIGMAS * tare.noise_n / math.sqrt(len(samples))
        if not felt_n + spare_n < settings.limits.least_share * gave_n:
            return ''
        return (
            f'the force is {felt_n:.2f} N at {depth_mm:.2f} mm, but the gel gave {gave_n:.2f} N '
            'in the surface search: is the sensor correct, does z move, is tip or gel loose? Is there gel at '
            f'({x_mm:.2f}, {y_mm:.2f}) mm from its middle, or does the plan reach beyond it?'
        )

    return expect
