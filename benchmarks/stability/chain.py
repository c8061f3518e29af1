"""The whole chain of the live nodes without their bus: from a picture and its stamp to a force message.

This module makes no decisions: image processing, model and drift monitor are those of the live launch, with its
parameters (config/live.yaml), called in the order of the messages.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.messages import types
from tactile_nodes.nodes.drift_monitor import DriftMonitorParams
from tactile_nodes.pipeline.drifting import Calibrated, VerdictStamps, usable
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.following import Following, FollowingParams
from tactile_nodes.pipeline.judge_force import LEAST_CONFIDENCE
from tactile_nodes.pipeline.reasons import calibration_reasons
from tactile_nodes.sensing.judge.drift import DriftMonitor
from tactile_nodes.sensing.picture.motion import PictureMotion

REST_FRAMES, CHECK_S = 16, DriftMonitorParams().check_s
"""Values from config/live.yaml and from the drift monitor's parameters."""

Values = Callable[[np.ndarray], np.ndarray]


class Watching:
    """Runs the drift monitor as its node does, for a simulated sensor."""

    def __init__(self, model: str, provenance: types.Provenance) -> None:
        self._calibrated = Calibrated(model, simulated=True)
        self._calibrated.use_model(provenance)
        self._calibrated.use_picture(
            conversions.image_message(np.zeros((0, 0), np.uint8), conversions.header(0, provenance.model_id))
        )
        self._monitor = DriftMonitor(self._calibrated.limits)
        self._monitor.use_calibration(self._calibrated.picture())
        self._stamps = VerdictStamps()

    def rest(self, stamp_ns: int, picture: np.ndarray) -> tuple[int, int]:
        """Set a new rest image; returns the stamp from which forces have new reasons, and these reasons."""
        self._monitor.rest(picture)
        return self._judged(stamp_ns, of_rest=True)

    def look(self, stamp_ns: int, picture: np.ndarray, taken_out: PictureMotion | None) -> tuple[int, int] | None:
        """Check a frame if a check is due; returns the same as `rest`."""
        if not self._monitor.is_due(stamp_ns, CHECK_S):
            return None
        self._monitor.frame(stamp_ns, picture, taken_out)
        return self._judged(stamp_ns)

    def feel(self, stamp_ns: int, force: types.ForceDistribution) -> None:
        """Add a published force."""
        self._monitor.force(stamp_ns, force.total, force.unlikeness, in_contact=force.in_contact, usable=usable(force))

    def _judged(self, stamp_ns: int, *, of_rest: bool = False) -> tuple[int, int]:
        verdict = self._monitor.verdict
        state = types.CalibrationState(level=int(verdict.level), reasons=int(verdict.reasons))
        return self._stamps.holds_from_ns(verdict, stamp_ns, of_rest=of_rest), calibration_reasons(state)


@cache
def fresh(model: str, compiled: bool) -> tuple[Estimating, Watching]:
    """Both before their first frame. Cached, because reading a model and rendering its gel takes long."""
    estimating = Estimating(model, compiled=compiled)
    return estimating, Watching(model, estimating.now.provenance)


class Chain:
    """The chain of one profile."""

    def __init__(self, model: str, *, compiled: bool = False) -> None:
        params = FollowingParams(model=model, reference_frames=REST_FRAMES)
        self._following = Following(params, compiled=compiled)
        self._following.begin_capture()
        self._estimating, self._watching = copy.deepcopy(fresh(model, compiled))

    def read(
        self, stamp_ns: int, image: np.ndarray, age_s: float = 0.0, values: Values | None = None
    ) -> types.ForceDistribution:
        """The force message of a picture of age `age_s`. `values` changes the features before the model."""
        head = conversions.header(stamp_ns, '')
        features = self._following.answer(image, head, acquire_s=0.0, waited_s=age_s)
        if (rest := self._following.announced()) is not None:
            self._estimating.calibration.add(*self._watching.rest(stamp_ns, np.array(conversions.image_array(rest))))
        if (state := self._watching.look(stamp_ns, image, conversions.picture_motion(features))) is not None:
            self._estimating.calibration.add(*state)
        if values is not None:
            features = replace(features, values=values(features.values), untouched=False)  # type: ignore[type-var]
        force = self._estimating.answer(features, '', LEAST_CONFIDENCE, 0.0)
        self._watching.feel(stamp_ns, force)
        return force

    def field(self, force: types.ForceDistribution) -> types.ForceField | None:
        """The fine maps for the last force, if the model has them."""
        return self._estimating.field(force)

    def nominal_n(self, total_n: float) -> float:
        """The usual error of the model for this total force."""
        return self._estimating.now.loaded.model.readout.nominal_n(total_n)
