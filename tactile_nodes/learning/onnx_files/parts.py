"""Parts shared by the graphs of both readouts: scaling of features, likeness, contacts as outputs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.onnx_files.graph import Operand, Value, Writer
from tactile_nodes.sensing.explain.model import FeatureLayout
from tactile_nodes.sensing.explain.network import CalibrationLayer, InputScaling
from tactile_nodes.sensing.geometry import BinGrid


@dataclass(frozen=True)
class Inputs:
    """The scaled features of a frame, which of them are missing (1 or 0), and the share of known regions seen.

    `features` and `confidence` are their unscaled inputs.
    """

    features: Value
    confidence: Value
    scaled: Value
    missing: Value
    seen: Value


@dataclass(frozen=True)
class Answer:
    """The outputs of a graph: one contact and its standard deviations, as in `ForceMap`."""

    normal_force: Value
    contact: Value
    position_sigma: Value
    total_sigma: Value
    unlikeness: Value


def write_inputs(
    writer: Writer, layout: FeatureLayout, scaling: InputScaling, layer: CalibrationLayer | None = None
) -> Inputs:
    """The graph's inputs, computed as in `InputScaling`: zero where no markers can be tracked.

    A calibration layer comes before the scaling.
    """
    grid = layout.rows, layout.cols
    meaning = f'{layout.encoding} of each region, row by row'
    features = writer.input('features', np.float32, (1, *grid, layout.channels), meaning)
    confidence = writer.input('confidence', np.float32, grid, 'confidence of each region, 0 to 1')
    adjusted = _adjusted(features, layer).reshape(1, *grid, layout.channels) if layer else features
    return replace(scale(adjusted, confidence, scaling), features=features)


def scale(features: Value, confidence: Value, scaling: InputScaling) -> Inputs:
    """Features scaled as in `InputScaling`."""
    writer, (*grid, channels) = features.writer, scaling.mean.shape
    followed = (confidence >= float(scaling.confidence_floor)).cast(np.float32)
    used = followed * scaling.trusted
    scaled = (features - scaling.mean) * scaling.gain
    each = used.reshape(*grid, 1)
    lost = (1 - followed) * (scaling.trusted > 0).astype(np.float32)
    missing = writer.op('Expand', lost.reshape(*grid, 1), writer.constant(np.array((*grid, channels))))
    seen = used.sum() / max(float(scaling.trusted.sum()), 1.0)
    return Inputs(features, confidence, (scaled * each).reshape(-1), missing.reshape(-1), seen)


def _adjusted(features: Value, layer: CalibrationLayer) -> Value:
    summed = features.writer.op('Gemm', features.reshape(1, -1), layer.weight, layer.bias, transB=1)
    return features.writer.op('Relu', summed)


def write_answer(writer: Writer, answer: Answer, inputs: Inputs, bins: BinGrid) -> None:
    """The graph's outputs."""
    shape = bins.rows, bins.cols
    writer.output('normal_force', answer.normal_force.cast(np.float32), shape, 'N on each bin, positive into the gel')
    writer.output('contact', answer.contact.cast(np.float32), (3,), 'x and y in mm, surface frame; force in N')
    for name, value, meaning in (
        ('position_sigma', answer.position_sigma, 'standard deviation of x and of y in mm; NaN: unknown'),
        ('total_sigma', answer.total_sigma, 'standard deviation of the force in N; NaN: unknown'),
        ('unlikeness', answer.unlikeness, 'novelty; above 1 the frame is unlike the training; NaN: unknown'),
        ('seen', inputs.seen, 'share of the known regions that show markers now'),
    ):
        writer.output(name, value.cast(np.float32), (), meaning)


def hypot(*parts: Value | float) -> Value:
    """Root of the sum of squares."""
    values = [each for each in parts if isinstance(each, Value)]
    known: Operand = float(sum(each**2 for each in parts if not isinstance(each, Value)))
    total = values[0] * values[0]
    for each in values[1:]:
        total = total + each * each
    return (total + known).sqrt()
