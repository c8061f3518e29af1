"""Small collection bags: presses of the simulated gel, written by the real writer as a rig records them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from coarse_table import linear_table

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE, Topic
from tactile_nodes.conversions import header, image_message
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Optics, Press, Shaping

START_NS = 1_700_000_000_000_000_000
SECOND_NS = 1_000_000_000
FRAME_NS = 16_666_667
PERIOD_NS = 5 * SECOND_NS
FRAMES = 3
PLAN = 'a1b2c3d4e5f6'
OTHER = dataclasses.replace(Gel(), seed=2, shear_modulus_mpa=1.5 * Gel().shear_modulus_mpa, camera_shift_mm=(0.6, -0.4))
"""Another gel: half as hard again, other markers, the camera aside."""


class Sensor:
    """The simulated gel under its camera; every image has noise of its own."""

    def __init__(self, gel: Gel | None = None) -> None:
        gel = gel or Gel()
        self.table: ContactTable = linear_table(gel)
        self._optics = Optics(gel, self.table)
        self._seed = 0

    def image(self, *presses: Shaping) -> np.ndarray:
        self._seed += 1
        return np.ascontiguousarray(centre_crop(self._optics.render(presses, self._seed)))

    def begin_anew(self) -> None:
        """Noise begins again: collections that are made alike hold the same images."""
        self._seed = 0

    def touching(self, x_mm: float, y_mm: float, depth_mm: float) -> Shaping:
        """What presses so deep at a place."""
        return Press(x_mm, y_mm, depth_mm)

    def force_n(self, depth_mm: float) -> float:
        """What it presses with."""
        return self.table.force_at(depth_mm)

    def rest(self) -> np.ndarray:
        return average([self.image() for _ in range(4)])


@dataclass
class Collection:
    """Writes one bag; a press takes five seconds, its window begins in the third."""

    folder: Path
    sensor: Sensor
    start_ns: int = START_NS
    namespace: str = ''
    writer: BagWriter = field(init=False)

    def __post_init__(self) -> None:
        self.writer = BagWriter(self.folder)
        for topic in (PRESS, PRESS_IMAGE, REFERENCE_IMAGE, RIG_STATE):
            self.writer.add_topic(BagTopic.of_type(self._name(topic), topic.type_name, latched=topic.qos.latched))

    def close(self) -> Path:
        self.writer.close()
        return self.folder

    def window_ns(self, slot: int) -> tuple[int, int]:
        begin = self.start_ns + slot * PERIOD_NS + 3 * SECOND_NS
        return begin, begin + FRAMES * FRAME_NS

    def reference(self, slot: int, image: np.ndarray | None = None) -> np.ndarray:
        """A rest image, captured just before a slot begins."""
        image = self.sensor.rest() if image is None else image
        self._write(
            REFERENCE_IMAGE, image_message(image, header(self.start_ns + slot * PERIOD_NS - FRAME_NS, 'camera'))
        )
        return image

    def images(self, stamp_ns: int, count: int, depth_mm: float, press: Shaping | None = None) -> None:
        """Images one after the other, and a rig state that says how deep the tip was."""
        state = types.RigState(header=header(stamp_ns, 'rig'), depth=depth_mm * 1e-3)
        self._write(RIG_STATE, state)
        for number in range(count):
            picture = self.sensor.image(*([press] if press else []))
            self._write(PRESS_IMAGE, image_message(picture, header(stamp_ns + number * FRAME_NS, 'camera')))

    def press(
        self, slot: int, number: int, x_mm: float, y_mm: float, depth_mm: float, *, frames: int = FRAMES, **changes: Any
    ) -> types.Press:
        """Two images of the untouched gel, those of the window, and the message about it.

        `frames` are in the bag, `FRAMES` were taken; `changes` changes the message.
        """
        begin_ns, end_ns = self.window_ns(slot)
        self.images(begin_ns - 2 * SECOND_NS, 2, -1.0)
        self.images(begin_ns, frames, depth_mm, self.sensor.touching(x_mm, y_mm, depth_mm))
        message = self.message(number, x_mm, y_mm, depth_mm, (begin_ns, end_ns), **changes)
        self._write(PRESS, message, end_ns + SECOND_NS // 10)
        return message

    def message(
        self, number: int, x_mm: float, y_mm: float, depth_mm: float, window_ns: tuple[int, int], **changes: Any
    ) -> types.Press:
        force = types.Vector3(z=-self.sensor.force_n(depth_mm))
        fields: dict[str, Any] = {
            'header': header(window_ns[0], 'gel_surface'),
            'plan_id': PLAN,
            'press': number,
            'attempt': 1,
            'position': types.Point(x=x_mm * 1e-3, y=y_mm * 1e-3),
            'depth': depth_mm * 1e-3,
            'depth_reported': depth_mm * 1e-3 + 1e-6,
            'indenter': 'sphere 1.2 mm',
            'window_start': messages.time_from_ns(window_ns[0]),
            'window_end': messages.time_from_ns(window_ns[1]),
            'frames': FRAMES,
            'samples': 50,
            'wrench': types.Wrench(force=force),
            'wrench_deviation': types.Wrench(force=types.Vector3(z=0.004)),
            'tare_id': 'feedbeef0001',
            'status': types.Press.STATUS_RECORDED,
        }
        return types.Press(**{**fields, **changes})

    def again(self, message: types.Press, slot: int) -> None:
        """The same message once more."""
        self._write(PRESS, message, self.window_ns(slot)[1] + SECOND_NS)

    def _name(self, topic: Topic) -> str:
        return f'{self.namespace}/{topic.name}'

    def _write(self, topic: Topic, message: Any, log_ns: int | None = None) -> None:
        stamp = messages.stamp_ns(message.header.stamp)
        self.writer.write(self._name(topic), messages.encode(message), log_ns or stamp + 5_000_000, stamp)


PLACES_MM = ((-3.0, -3.0), (3.0, -3.0), (-3.0, 3.0), (1.5, 3.0))
DEPTHS_MM = (0.5, 1.0, 1.5)


def whole_collection(folder: Path, sensor: Sensor) -> Path:
    """Twelve good presses, four places at three depths; a new rest image before the seventh."""
    collection = Collection(folder, sensor)
    plan = [(*place, depth) for place in PLACES_MM for depth in DEPTHS_MM]
    for slot, (x_mm, y_mm, depth_mm) in enumerate(plan):
        if slot in (0, 6):
            collection.reference(slot)
        collection.press(slot, slot + 1, x_mm, y_mm, depth_mm)
    return collection.close()


def spread_collection(
    folder: Path, sensor: Sensor, count: int, reach_mm: float = 11.0, depths_mm: tuple[float, float] = (0.3, 1.5)
) -> Path:
    """Presses anywhere within a reach, between two depths, against one rest image."""
    collection, random = Collection(folder, sensor), np.random.default_rng(7)
    collection.reference(0)
    for slot in range(count):
        x_mm, y_mm = random.uniform(-reach_mm, reach_mm, 2)
        collection.press(slot, slot + 1, float(x_mm), float(y_mm), float(random.uniform(*depths_mm)))
    return collection.close()
