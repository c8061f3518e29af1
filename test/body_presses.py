"""Presses of any rigid body on a simulated gel, solved at finite strain with friction, as pictures and as features."""

from __future__ import annotations

import dataclasses

import numpy as np
from press_bags import Sensor

from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Shaping
from tactile_nodes.simulation.touch.bricks import Bricks, Layer
from tactile_nodes.simulation.touch.table import Touch, TouchTable, node_forces
from tactile_nodes.simulation.touch.track import Way, solve_track

STIFFER = 1.5
GEL = dataclasses.replace(Gel(), seed=7, shear_modulus_mpa=STIFFER * Gel().shear_modulus_mpa)
"""Half as hard again as its description says, with other markers than the models'."""

BODY, UNTOUCHED, LIGHTEST = 'body', 14, 0.15


class BodySensor(Sensor):
    """A gel that a body presses, with up to `most_n`, solved on so many bricks sideways and down."""

    def __init__(self, name: str, most_n: float, gel: Gel = GEL, cells: int = 64, rows: int = 6) -> None:
        super().__init__(gel)
        self._gel = gel
        way = Way(force_mm2=most_n / gel.shear_modulus_mpa, press_stages=3)
        track = solve_track(
            Bricks(Layer(cells, 40.0 / cells, gel.layer_mm, rows=rows)), KnownBody.named(name).body, way
        )
        self.touched = TouchTable.of_track(track, -gel.skin_mm)
        self._optics = Optics(gel, self.table, bodies={BODY: self.touched})

    def touching(self, x_mm: float, y_mm: float, depth_mm: float) -> Shaping:
        stage = float(np.interp(depth_mm, self.touched.depth_mm, np.arange(self.touched.stages)))
        return Touch(BODY, x_mm, y_mm, 0.0, stage)

    def force_n(self, depth_mm: float) -> float:
        return self.acting(0.0, 0.0, depth_mm)[0]

    def acting(self, x_mm: float, y_mm: float, depth_mm: float) -> tuple[float, np.ndarray]:
        """The whole normal force (N), and its centre (mm)."""
        touch = self.touching(x_mm, y_mm, depth_mm)
        assert isinstance(touch, Touch)
        place, force = node_forces(self.touched, touch)
        total = float(force[:, 2].sum())
        return total * self._gel.shear_modulus_mpa, (place * force[:, 2:]).sum(axis=0) / total

    def presses(self, model: LoadedModel, count: int, reach_mm: float, seed: int) -> tuple[Dataset, np.ndarray]:
        """Pictures of the gel untouched, then presses, as a model sees them; and total and centre of all of these."""
        random, deepest = np.random.default_rng(seed), float(self.touched.depth_mm[-1])
        plan = [(*random.uniform(-reach_mm, reach_mm, 2), deepest * random.uniform(LIGHTEST, 1)) for _ in range(count)]
        with Measurer(Choice(*model.flow), Choice(*model.encoding), model.image_size[0]) as measurer:
            measurer.use_reference(self.rest())
            measured = [measurer.measure([self.image()]) for _ in range(UNTOUCHED)]
            measured += [measurer.measure([self.image(self.touching(*each))]) for each in plan]
        acting = [self.acting(*each) for each in plan]
        rows = [(0.0, 0.0, -1.0, 0.0)] * UNTOUCHED + [
            (*each, force) for each, (force, _) in zip(plan, acting, strict=True)
        ]
        dataset = Dataset(
            np.stack([each.values for each in measured]), np.array(rows, np.float32), np.arange(len(rows)),
            np.stack([each.confidence for each in measured]), f'{seed}',
        )  # fmt: skip
        return dataset, np.array([(force, *centre) for force, centre in acting])
