"""Between the drift monitor and the bus: what the calibration looked like, which forces count, what a verdict tells."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from tactile_nodes import conversions
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.gel_list import GelList
from tactile_nodes.messages import stamp_ns, time_from_ns, types
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.judge.drift import Limits
from tactile_nodes.sensing.judge.drift_alarm import Level
from tactile_nodes.sensing.judge.drift_verdict import Verdict
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics

LEAD_S = 0.5
"""A worse verdict holds for images from so much later on, so that it reaches the force estimator before them."""

FORCE = types.ForceDistribution
EXPLAINED = (
    FORCE.REASON_CALIBRATION_AGEING
    | FORCE.REASON_CALIBRATION_INVALID
    | FORCE.REASON_FOREIGN_MOTION
    | FORCE.REASON_REST_DOUBTFUL
    | FORCE.REASON_UNLIKE_TRAINING
    | FORCE.REASON_BEGINNING
    | FORCE.REASON_UNCALIBRATED
)
"""What the monitor itself says of a force, or what is to be found out; any other reason makes a frame useless to it."""

FRAMES = 16
FILE, GEL, FIRST = 'the rest image in the model file', 'the simulated gel of the model', 'the first rest image'


class Calibrated:
    """Puts together what the force estimator says of its model and what a model's card says of its gel.

    Raises:
        ModelError: there is no such model.
    """

    def __init__(self, model: str, *, simulated: bool) -> None:
        loaded = load_model(find_model(model))
        self.limits = limits_of(loaded)
        self.model_id = ''
        self._own_gel = loaded.gel
        self._described_id = loaded.model_id if loaded.of_description else None
        self._gel = _simulated_gel(loaded) if simulated else None
        self._used_gel: str | None = None
        self._shown: tuple[str, np.ndarray] | None = None

    def use_model(self, message: types.Provenance) -> None:
        """Take which model is in use from now on."""
        self.model_id, self._used_gel = message.model_id, message.gel

    def use_picture(self, message: types.Image) -> None:
        """Take the rest image of a model file, or that it holds none."""
        self._shown = message.header.frame_id, np.array(conversions.image_array(message))

    @property
    def complete(self) -> bool:
        """Whether both are known, and of the same model."""
        return self._shown is not None and self._shown[0] == self.model_id

    @property
    def is_calibrated(self) -> bool:
        """False of a model that follows from a description alone."""
        return self.model_id != self._described_id

    @property
    def origin(self) -> str:
        """Which picture is compared with, in words."""
        if self.complete and self._shown is not None and self._shown[1].size:
            return FILE
        return GEL if self._gel is not None and self._used_gel == self._own_gel else FIRST

    def picture(self) -> UInt8[np.ndarray, 'h w'] | None:
        """The rest image of the calibration; None where there is none, and the first one has to stand in."""
        if self.origin == FILE:
            assert self._shown is not None
            return self._shown[1]
        return rest_picture(*self._gel) if self.origin == GEL and self._gel is not None else None


def limits_of(loaded: LoadedModel) -> Limits:
    """From where on a calibration of a model is ageing and invalid."""
    readout = loaded.model.readout
    witnessed = isinstance(readout, NetworkReadout) and readout.witness is not None
    return Limits.of_flow(loaded.flow[0], witnessed=witnessed)


def usable(force: types.ForceDistribution) -> bool:
    """Whether a force may be compared with another."""
    return not force.reasons & ~EXPLAINED


class Told:
    """From which stamp on a verdict holds, beside the one that was told before.

    On a new rest image it holds from that image on, and so does a better one: what little of it comes late is told less
    well than it is. A worse one holds `LEAD_S` later.
    """

    def __init__(self) -> None:
        self._level = Level.VALID

    def holds_from_ns(self, verdict: Verdict, at_ns: int, *, of_rest: bool) -> int:
        """For a verdict that rests on an image of a stamp."""
        better, self._level = verdict.level < self._level, verdict.level
        return at_ns if of_rest or better else at_ns + round(LEAD_S * NS_PER_S)


def kept_in(gels: GelList, state: types.CalibrationState) -> bool:
    """Keep in the list of the lab's gels what a state says of a calibration; whether the list has that one.

    Raises:
        ConfigurationError: the list cannot be used.
    """
    if state.level not in {Level.VALID, Level.AGEING, Level.INVALID}:
        return False
    level, remedy = Level(state.level), '' if state.level == Level.VALID else state.text
    return gels.look(state.model_id, level.name.lower(), remedy, stamp_ns(state.header.stamp))


def state_message(
    verdict: Verdict, at_ns: int, from_ns: int, calibrated: Calibrated, reference_id: str
) -> types.CalibrationState:
    """What a verdict tells that rests on an image of a stamp, and holds from another one on."""
    return types.CalibrationState(
        header=conversions.header(at_ns, ''),
        valid_from=time_from_ns(from_ns),
        model_id=calibrated.model_id,
        calibration=calibrated.origin,
        reference_id=reference_id,
        **conversions.calibration_fields(verdict),
    )


def _simulated_gel(loaded: LoadedModel) -> tuple[Gel, int] | None:
    """The gel that a model was trained on and the side of its images, if its card describes a simulated one."""
    described = {name: value for name, value in loaded.card['gel'].items() if name != 'id'}
    if not described:
        return None
    try:
        return Gel.from_mapping(described, 'the card of the model'), loaded.image_size[0]
    except ConfigurationError:  # a real gel, described in its own words
        return None


def rest_picture(gel: Gel, side_px: int) -> UInt8[np.ndarray, 'side side']:
    """A simulated gel at rest: the mean of 16 frames. Nothing presses, so any contact table serves."""
    optics = Optics(gel, contact_table(Gel()))
    return average([centre_crop(optics.render((), number), side_px, side_px) for number in range(FRAMES)])
