"""Whether the force rises on the way down as the gel says: else the sensor, the tip or the machine tells a tale.

What the gel gives is known from its loading lines, felt where the surface was searched for (`surface`). They go on by
Hertz (F ~ depth^1.5), or straight for a flat punch. On the simulated gels, 0.1 to 2.2 mm deep, the force is 0.68 to
1.5 times that; where they settle, it is greater on a fast way down than at the slow steps of the search. A sensor that
tells the force of 0.3 mm for ever is at half of what is expected at 0.48 mm.
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
"""Asked on the way, with where the machine was and what was felt since: why to stop; empty: go on."""


def rising(surface: Surface, tare: Tare, settings: CollectionSettings, x_mm: float, y_mm: float) -> Expect:
    """What to expect on the way down at a place of the gel; nothing before its stiffness is known.

    The surface may lie deeper by `surface.flat_mm` than it was found, the force be `limits.least_share` of that of the
    softest corner, less what counts as no touch. What was felt *since* the machine was there is never too little for
    that depth, for the tip has gone deeper meanwhile.
    """

    def expect(place: Place, samples: Sequence[Sample]) -> str:
        depth_mm = surface.depth_mm(x_mm, y_mm, place[2])
        gave_n = surface.force_n(depth_mm - settings.surface.flat_mm)
        felt_n = float(pressing_n(wrenches(samples), tare, settings.mounting).mean())
        spare_n = settings.surface.least_n + SIGMAS * tare.noise_n / math.sqrt(len(samples))
        if not felt_n + spare_n < settings.limits.least_share * gave_n:
            return ''
        return (
            f'the force is {felt_n:.2f} N at {depth_mm:.2f} mm, where the gel gave {gave_n:.2f} N '
            'when its surface was felt: does the sensor tell the truth, does z move, is tip or gel loose?'
        )

    return expect
