"""A described sensor: the model that follows from its description, and what it reads of simulated presses."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.learning.field.calibration import described_model
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceMap
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensors import (
    BinSettings,
    CameraDescription,
    GelDescription,
    ImageSettings,
    PatternDescription,
    Sensor,
)
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Optics, Press


def sensor_of(
    name: str,
    image: ImageSettings,
    gel: GelDescription,
    markers: int,
    bins: BinSettings,
    middle_mm: tuple[float, float] = (0.0, 0.0),
) -> Sensor:
    """One with 20 px a millimetre and many small spheres, whose camera looks at a place of the gel."""
    principal_px = ((image.width - 1) / 2, (image.height - 1) / 2)
    return Sensor(
        name, image, CameraDescription('pinhole', 290.0, (400.0, 400.0), (0.0,) * 5, principal_px, (*middle_mm, -20.0)),
        gel, PatternDescription('spheres', markers, (0.1, 0.15)), bins,
    )  # fmt: skip


def model_of(sensor: Sensor, folder: Path) -> LoadedModel:
    """As `tactile calibrate --sensor` makes it."""
    file = folder / f'{sensor.name}.safetensors'
    described_model(load_model(find_model('field')), sensor, '', file, Progress())
    return load_model(file)


class DescribedChain:
    """The simulated sensor, and a model that reads it; `table` says how hard the gel answers the tip, or another."""

    def __init__(
        self, sensor: Sensor, loaded: LoadedModel, table: ContactTable | None = None, *, compiled: bool = False
    ) -> None:
        gel = dataclasses.replace(gel_of(sensor), mechanics='linear')
        self.table = table or linear_table(gel)
        self._image, self._optics, self._frames = sensor.image, Optics(gel, self.table), iter(range(1000))
        self._flow, self._encoding = make_flow(*loaded.flow), make_encoding(*loaded.encoding)
        self._force = ForceEstimator(loaded.model, compiled=compiled)
        self._flow.set_reference(np.mean([self.picture() for _ in range(8)], axis=0).round().astype(np.uint8))

    def picture(self, *presses: Press) -> np.ndarray:
        """The next frame, cropped about its middle."""
        frame, (width, height) = self._optics.render(presses, next(self._frames)), self._image.crop_px
        top, left = (frame.shape[0] - height) // 2, (frame.shape[1] - width) // 2
        return np.ascontiguousarray(frame[top : top + height, left : left + width])

    def read(self, *presses: Press) -> ForceMap:
        """What is reported of the next frame."""
        return self._force.predict(self._encoding.encode(self._flow.displacement(self.picture(*presses))))

    def require_read(self, places_mm: list[tuple[float, float]], depth_mm: float, share: float, off_mm: float) -> None:
        """Presses so deep are read within a share of their force and so near to where they are; at rest nothing is."""
        for x_mm, y_mm in places_mm:
            read = self.read(Press(x_mm, y_mm, depth_mm))
            assert read.total_n == pytest.approx(self.table.force_at(depth_mm), rel=share)
            assert np.hypot(read.contacts[0].x_mm - x_mm, read.contacts[0].y_mm - y_mm) < off_mm
        assert self.read().total_n < 0.005
