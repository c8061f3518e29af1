"""Builds the messages of what was found."""

from __future__ import annotations

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.judge_force import Judged
from tactile_nodes.sensing.explain.model import ForceMap
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.features import FeatureEncoding, Features
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.picture.motion import PictureMotion


def tell(
    frame: Frame, method: str, reference_id: str, nothing: Features, stages: types.StageTimes
) -> types.FlowFeatures:
    """The features of a frame against the rest image of that id; `nothing` for a frame that was not measured."""
    moved_px, motion = 0.0, PictureMotion()
    if frame.registration:
        moved_px, motion = frame.registration.size_px, frame.registration.since_rest
    elif frame.dots:
        moved_px, motion = frame.dots.size_px, frame.dots.motion
    return types.FlowFeatures(
        header=frame.head,
        image_width=frame.image.shape[1],
        image_height=frame.image.shape[0],
        image_level=frame.level,
        method=method,
        reference_id=reference_id,
        untouched=frame.untouched,
        moved=moved_px,
        picture_motion=np.array(motion.terms if moved_px else (), np.float32),
        reasons=frame.reasons,
        stages=stages,
        **conversions.feature_fields(frame.features or nothing),
    )


def tell_force(
    found: ForceMap,
    verdict: Judged,
    touching: tuple[Contact, ...],
    bins: BinGrid,
    *,
    head: types.Header,
    provenance: types.Provenance,
    stages: types.StageTimes,
) -> types.ForceDistribution:
    """The message of a force that a model found, with its verdict."""
    fields = conversions.force_fields(
        found.normal_force_n, bins, touching,
        total_sigma_n=verdict.sigma_n, unlikeness=found.unlikeness, acting=found.acting,
    )  # fmt: skip
    return types.ForceDistribution(
        header=head, status=verdict.status, reasons=verdict.reasons, provenance=provenance, stages=stages, **fields
    )


def no_motion(encoding: FeatureEncoding) -> Features:
    """No motion with zero confidence: the features of a frame that was not measured."""
    rows, cols = (int(str(encoding.options[name])) for name in ('rows', 'cols'))
    still = np.zeros((rows, cols, len(encoding.channels)), np.float32)
    return Features(encoding.name, still, np.zeros((rows, cols), np.float32))
