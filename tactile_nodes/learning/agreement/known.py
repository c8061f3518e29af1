"""What is known of a sensor before its tables are read: its description, and the forces that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.learning.agreement.objections import ALIKE, force_objection, from_centre, strength_of
from tactile_nodes.learning.field.calibration import sensor_of
from tactile_nodes.learning.field.fit import described, scaling_of
from tactile_nodes.learning.tables.pictures import OneSize
from tactile_nodes.model_file import SENSOR, LoadedModel
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, Float32

NOISE_PX = 0.02
"""Noise of regions for which no model states it."""
JUDGES = 40
"""The most presses of a table whose forces are estimated."""
FORCE_TIMES = 5.0
"""Largest ratio between given forces and those expected from a description: gels differ by less, units by more."""
DIFFER = 1.6
"""Estimated forces of different presses differ by this factor (nine of ten) if their forces differ; those of one force
differ by 1.2."""


@dataclass(frozen=True)
class Known:
    """The sensor's description, from a person or from a model, and that model; None if unknown.

    `loaded` gives the hardness of the gel if it is the one described by `sensor`.
    """

    sensor: Sensor | None = None
    loaded: LoadedModel | None = None

    @classmethod
    def of(cls, loaded: LoadedModel, sensor: Sensor | None = None) -> Known:
        """The description of a model, or that of a person, which then is of another sensor."""
        if sensor is not None:
            return cls(sensor)
        return cls(sensor_of(loaded.card, loaded.model_id) if SENSOR in loaded.card else None, loaded)

    @property
    def size(self) -> OneSize:
        """The image size to require: that of the description, if nothing else is known of the sensor."""
        trained = self.loaded is not None and not self.loaded.of_description
        return OneSize.of(None if trained else self.sensor)

    def forces_n(
        self, motion: Float32[np.ndarray, 'n rows cols 2'], confidence: Float32[np.ndarray, 'n rows cols']
    ) -> Float[np.ndarray, ' n']:
        """The forces expected from the regions' motion, by the field alone, for any body.

        Raises:
            ConfigurationError: by the description hardly any region sees the gel.
        """
        readout = self._readout(motion.shape[1:3])
        found = [
            readout.solver.field(*readout.weighed(each, sure)[1:]).forces_n[0].sum()
            for each, sure in zip(motion, confidence, strict=True)
        ]
        return np.array(found, float)

    def force_objection(
        self,
        force_n: Float[np.ndarray, ' n'],
        motion: Float32[np.ndarray, 'n rows cols 2'],
        confidence: Float32[np.ndarray, 'n rows cols'],
    ) -> str:
        """What is wrong with the given forces, compared with what the images show. Empty if nothing is wrong.

        That is the expected forces if the sensor is described, else the motion.

        Raises:
            ConfigurationError: by the description hardly any region sees the gel.
        """
        if self.sensor is None:
            strength = strength_of(motion, confidence)
            return force_objection(force_n, strength.sum(axis=(1, 2)), from_centre(strength))
        few = slice(None, None, max(1, len(force_n) // JUDGES))
        given, expected = force_n[few], self.forces_n(motion[few], confidence[few])
        if objection := force_objection(given, expected):
            return objection
        given, expected = given[expected > 0], expected[expected > 0]
        if not len(given):
            return ''
        times = float(np.median(given / expected))
        if not 1 / FORCE_TIMES <= times <= FORCE_TIMES:
            return f'forces are about {_round(times)} times those expected from the description: check the unit'
        least, most = np.quantile(expected, (0.1, 0.9)).tolist()
        if given.max() <= ALIKE * given.min() and most > DIFFER * least:
            return (
                f'the given forces of {given.min():.3g} to {given.max():.3g} N are nearly equal, but according to the '
                f'description the images show forces that differ by a factor of {most / least:.1f}'
            )
        return ''

    def _readout(self, regions: tuple[int, ...]) -> FieldReadout:
        """The readout of the model, or one that follows from the description alone."""
        if self.loaded is not None and isinstance(self.loaded.model.readout, FieldReadout):
            return self.loaded.model.readout
        assert self.sensor is not None
        return described(self.sensor, scaling_of(self.sensor, 1 / NOISE_PX, regions)).readout


def _round(times: float) -> str:
    return f'{times:.0f}' if times >= 10 else f'{times:.2g}'
