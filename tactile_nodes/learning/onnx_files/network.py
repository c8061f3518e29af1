"""The graph of a network readout: `tactile_nodes.sensing.explain.network` in ONNX."""

from __future__ import annotations

import numpy as np

from tactile_nodes.learning.onnx_files.graph import Value, Writer
from tactile_nodes.learning.onnx_files.parts import Answer, Inputs, hypot, scale
from tactile_nodes.learning.onnx_files.response import write_response
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.network import CONTRADICTED_SIGMAS, TINY_N, Mlp, NetworkReadout
from tactile_nodes.sensing.explain.novelty_check import NoveltyCheck
from tactile_nodes.sensing.explain.reading import UNKNOWN
from tactile_nodes.sensing.features import PolarMean
from tactile_nodes.sensing.geometry import BinGrid

_ACTIVATIONS = {'logistic': 'Sigmoid', 'relu': 'Relu'}


def write_network(writer: Writer, readout: NetworkReadout, inputs: Inputs) -> Answer:
    """Scaled features to forces, place, and the readout's estimates of its errors."""
    forces = _layers(writer, readout.network, inputs.scaled) * readout.output_scale_n
    total, spread = forces.cast(np.float64).sum(), readout.spread
    sigma = hypot(total * spread.share, spread.floor_n)
    unlike = writer.constant(np.float32(UNKNOWN))
    if readout.likeness:
        unlike = _unlikeness(readout.likeness, inputs.scaled)
    if isinstance(readout.novelty_check, NoveltyCheck):
        unlike = _checked(writer, readout.novelty_check, inputs, total, sigma, unlike)
    return Answer(
        forces.reshape(readout.bins.rows, readout.bins.cols),
        writer.concat(_place(forces, readout.bins), total),
        writer.constant(np.float32(UNKNOWN)),
        sigma,
        unlike,
    )


def _checked(writer: Writer, check: NoveltyCheck, inputs: Inputs, total: Value, sigma: Value, unlike: Value) -> Value:
    """The largest known novelty, including that of the novelty check; see `NetworkReadout.read`."""
    motion = _as_motion(inputs.features) if check.encoding == PolarMean.name else inputs.features
    checked = write_response(writer, check.readout, scale(motion, inputs.confidence, check.readout.scaling))
    force = checked.contact[2]
    apart = writer.op('Abs', total - force) / (sigma * CONTRADICTED_SIGMAS).most(TINY_N)
    novelties = [each.cast(np.float64) for each in (unlike, checked.unlikeness, apart)]
    lowest = writer.constant(np.float64(-1))
    known = [writer.op('IsNaN', each, dtype=bool).where(lowest, each) for each in novelties]
    largest = known[0].most(known[1]).most(known[2])
    return (largest < 0).where(writer.constant(np.float64(UNKNOWN)), largest)


def _as_motion(features: Value) -> Value:
    """Mean magnitude and angle as motion along x and y; see `as_motion`."""
    writer = features.writer
    magnitude, angle = (writer.op('Gather', features, writer.constant(np.array([each])), axis=-1) for each in (0, 1))
    return writer.op('Concat', *(magnitude * writer.op(kind, angle) for kind in ('Cos', 'Sin')), axis=-1)


def _layers(writer: Writer, network: Mlp, values: Value) -> Value:
    values = values.reshape(1, -1)
    last = len(network.weights) - 1
    for number, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        values = writer.op('Gemm', values, weight, bias, transB=1)
        if number < last:
            values = writer.op(_ACTIVATIONS[network.hidden], values)
    return values.reshape(-1)


def _place(forces: Value, bins: BinGrid) -> Value:
    """Force-weighted mean of the centres of the strongest bin and its neighbours; see `contact_position_mm`."""
    writer = forces.writer
    strongest = writer.op('ArgMax', forces, axis=0, keepdims=0, dtype=np.int64)
    near = writer.op('Gather', writer.constant(_neighbours(bins)), strongest, axis=0)
    weights = forces.most(0).cast(np.float64) * near
    total = weights.sum()
    centres = bins.centres_mm.reshape(-1, 2).astype(np.float64)
    alone = writer.op('Gather', writer.constant(centres), strongest, axis=0)
    return (total < 1e-300).where(alone, weights @ centres / total.most(1e-300))


def _neighbours(bins: BinGrid) -> np.ndarray:
    """1 for bins that touch, also at a corner, and for each with itself."""
    row, col = np.divmod(np.arange(bins.count), bins.cols)
    touching = (abs(row[:, None] - row) <= 1) & (abs(col[:, None] - col) <= 1)
    return touching.astype(np.float64)


def _unlikeness(likeness: Likeness, inputs: Value) -> Value:
    centred = inputs - likeness.mean
    known = likeness.directions @ centred
    squared = centred @ centred
    left, size = ((each / likeness.mean.size).sqrt() for each in ((squared - known @ known).most(0), squared))
    return left / (likeness.floor + likeness.share * size)
