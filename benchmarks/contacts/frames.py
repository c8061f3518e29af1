"""Pictures of contacts as a stream: a rest image, then each contact between frames without contact."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import disturbances as disturb
from benchmarks.contacts.cases import Case
from benchmarks.stability.chain import REST_FRAMES
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.shapes import Bool, Float32, UInt8
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Optics, Shaping
from tactile_nodes.simulation.touch.table import TouchTable

RATE_HZ = 60
FREE_FRAMES, HELD_FRAMES = 4, 5
"""Frames between two contacts, and of each contact; the last one is scored, after the chain has settled."""


class TouchOptics(Optics):
    """A gel touched by bodies, with missing markers and a blurred picture."""

    def __init__(
        self,
        gel: Gel,
        table: ContactTable,
        bodies: dict[str, TouchTable],
        gone: Callable[[Float32[np.ndarray, 'markers 3']], Bool[np.ndarray, ' markers']] | None = None,
        blur_px: float = 0.0,
    ) -> None:
        super().__init__(gel, table, bodies=bodies)
        self._blur_px = blur_px
        if gone is not None:
            self._light = np.where(gone(self.markers_mm), np.float32(0), self._light)
            self._rest = self._draw(self.project(()))
            self._last = (), self._rest

    def radiance(self, presses: tuple[Shaping, ...]) -> Float32[np.ndarray, 'h w']:
        """The light on the camera's sensor."""
        light = super().radiance(presses)
        return disturb.blurred(light, self._blur_px) if self._blur_px else light


@dataclass(frozen=True)
class Condition:
    """A disturbance of the picture after the rest image was taken."""

    name: str
    gel: Callable[[Gel], Gel] = lambda gel: gel
    gone: Callable[[Float32[np.ndarray, 'markers 3']], Bool[np.ndarray, ' markers']] | None = None
    blur_px: float = 0.0


CONDITIONS = (
    Condition('undisturbed'),
    Condition('knocked by 3 px', lambda gel: disturb.knocked(gel, 3.0)),
    Condition('turned by 1 degree', lambda gel: disturb.rolled(gel, 1.0)),
    Condition('light -30 %', lambda gel: disturb.dimmed(gel, 0.7)),
    Condition('light +30 %', lambda gel: disturb.dimmed(gel, 1.3)),
    Condition('blur 1 px', blur_px=1.0),
    Condition('noise 4x', lambda gel: disturb.noisier(gel, 4.0)),
    Condition('20 % of markers gone', gone=lambda markers: disturb.gone_anywhere(markers, 0.2)),
)


@dataclass(frozen=True)
class Frame:
    """A picture, its stamp, and its contact if the frame is scored."""

    stamp_ns: int
    picture: UInt8[np.ndarray, 'h w']
    judged: Case | None = None


def frames(
    gel: Gel, cases: Sequence[Case], condition: Condition, seed: int, size_px: tuple[int, int] = (440, 440)
) -> Iterator[Frame]:
    """The whole stream from the first frame on, cropped to `size_px` around the middle."""
    bodies = {case.touch.body: case.table for case in cases}
    table, crop = contact_table(gel), Crop.centred(gel.image_width, gel.image_height, *size_px)
    calm, disturbed = Optics(gel, table), TouchOptics(
        condition.gel(gel), table, bodies, condition.gone, condition.blur_px
    )  # fmt: skip
    number = 0

    def shown(optics: Optics, presses: tuple[Shaping, ...], judged: Case | None = None) -> Frame:
        nonlocal number
        number += 1
        picture = np.ascontiguousarray(crop.apply(optics.render(presses, seed + number)))
        return Frame(number * NS_PER_S // RATE_HZ, picture, judged)

    for _ in range(REST_FRAMES):
        yield shown(calm, ())
    for _ in range(RATE_HZ // 2):
        yield shown(disturbed, ())
    for case in cases:
        for _ in range(FREE_FRAMES):
            yield shown(disturbed, ())
        for left in reversed(range(HELD_FRAMES)):
            yield shown(disturbed, (case.touch,), None if left else case)
