"""Data of the drift monitor: the rest image of the calibration, the forces that count, the messages of a verdict."""

from __future__ import annotations

import numpy as np

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
from tactile_nodes.sensing.rest.reference import average, content_id
from tactile_nodes.shapes import UInt8
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics

LEAD_S = 0.5
"""A worse verdict holds from this much later on, so that it reaches the force estimator before those images do."""

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
"""Reasons that the monitor sets itself or has to detect. With any other reason it ignores the frame."""

FRAMES = 16
FILE, GEL, FIRST = 'the rest image in the model file', 'the simulated gel of the model', 'the first rest image'


class Calibrated:
    """Combines what the force estimator reports of its model with what the model's card says of its gel.

    Raises:
        ModelError: there is no such model.
    """

    def __init__(self, model: str, *, simulated: bool) -> None:
        loaded = load_model(find_model(model))
        self.limits = limits_of(loaded)
        self.model_id = ''
        self._own_gel = loaded.gel
        self._described = {loaded.model_id} if loaded.of_description else set()
        self._gel = _simulated_gel(loaded) if simulated else None
        self._used_gel: str | None = None
        self._shown: tuple[str, np.ndarray] | None = None

    def use_model(self, message: types.Provenance) -> None:
        """Set the model in use from now on."""
        self.model_id, self._used_gel = message.model_id, message.gel

    def use_force(self, message: types.ForceDistribution) -> bool:
        """Whether a force is the first to say that its model was made from a description alone.

        No other message says it of a model that replaced the first one.
        """
        known, model_id = len(self._described), message.provenance.model_id
        if message.reasons & FORCE.REASON_UNCALIBRATED:
            self._described.add(model_id)
        return len(self._described) > known

    def use_picture(self, message: types.Image) -> None:
        """Set the rest image of the model file; the message is empty if the file holds none."""
        self._shown = message.header.frame_id, np.array(conversions.image_array(message))

    @property
    def complete(self) -> bool:
        """Whether model and rest image are known and belong together."""
        return self._shown is not None and self._shown[0] == self.model_id

    @property
    def ids(self) -> tuple[str, str, bool]:
        """The ids of model and rest image (empty if none came yet), and whether there is a calibration."""
        shown = content_id(self._shown[1]) if self._shown is not None else ''
        return self.model_id, shown, self.is_calibrated

    @property
    def is_calibrated(self) -> bool:
        """False for a model that was made from a description alone."""
        return self.model_id not in self._described

    @property
    def origin(self) -> str:
        """Where the image for the comparison comes from, in words."""
        if self.complete and self._shown is not None and self._shown[1].size:
            return FILE
        return GEL if self._gel is not None and self._used_gel == self._own_gel else FIRST

    def picture(self) -> UInt8[np.ndarray, 'h w'] | None:
        """The rest image of the calibration; None if there is none, so that the first rest image stands in for it."""
        if self.origin == FILE:
            assert self._shown is not None
            return self._shown[1]
        return rest_picture(*self._gel) if self.origin == GEL and self._gel is not None else None


def limits_of(loaded: LoadedModel) -> Limits:
    """The limits from which on the calibration of a model is ageing or invalid."""
    readout = loaded.model.readout
    novelty_checked = isinstance(readout, NetworkReadout) and readout.novelty_check is not None
    return Limits.of_flow(loaded.flow[0], novelty_checked=novelty_checked)


def usable(force: types.ForceDistribution) -> bool:
    """Whether a force may be compared with another."""
    return not force.reasons & ~EXPLAINED


class VerdictStamps:
    """The stamp from which on a verdict holds, given the verdict published before it.

    A verdict on a new rest image holds from that image on. So does a better verdict: the few forces that it reaches
    late are rated worse than they are. A worse verdict holds `LEAD_S` later.
    """

    def __init__(self) -> None:
        self._level = Level.VALID

    def holds_from_ns(self, verdict: Verdict, at_ns: int, *, of_rest: bool) -> int:
        """The stamp for a verdict based on the image of `at_ns`."""
        better, self._level = verdict.level < self._level, verdict.level
        return at_ns if of_rest or better else at_ns + round(LEAD_S * NS_PER_S)


def kept_in(gels: GelList, state: types.CalibrationState) -> bool:
    """Store the state of a calibration in the lab's gel list; returns whether the list holds that calibration.

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
    """The message of a verdict, with the stamp of the image it is based on and the stamp from which on it holds."""
    return types.CalibrationState(
        header=conversions.header(at_ns, ''),
        valid_from=time_from_ns(from_ns),
        model_id=calibrated.model_id,
        calibration=calibrated.origin,
        reference_id=reference_id,
        **conversions.calibration_fields(verdict),
    )


def _simulated_gel(loaded: LoadedModel) -> tuple[Gel, int] | None:
    """The gel that a model was trained on and the side of its images [px], if its card describes a simulated gel."""
    described = {name: value for name, value in loaded.card['gel'].items() if name != 'id'}
    if not described:
        return None
    try:
        return Gel.from_mapping(described, 'the card of the model'), loaded.image_size[0]
    except ConfigurationError:  # a real gel, described in other words
        return None


def rest_picture(gel: Gel, side_px: int) -> UInt8[np.ndarray, 'side side']:
    """A simulated gel at rest: the mean of 16 frames. Nothing presses, so any contact table will do."""
    optics = Optics(gel, contact_table(Gel()))
    return average([centre_crop(optics.render((), number), side_px, side_px) for number in range(FRAMES)])
