"""The graph of a network readout: `tactile_nodes.sensing.network` in ONNX."""

from __future__ import annotations

import numpy as np

from tactile_nodes.learning.onnx_graph import Value, Writer
from tactile_nodes.learning.onnx_parts import Answer, Inputs, hypot
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.likeness import Likeness
from tactile_nodes.sensing.network import Mlp, NetworkReadout
from tactile_nodes.sensing.reading import UNKNOWN

_ACTIVATIONS = {'logistic': 'Sigmoid', 'relu': 'Relu'}


def write_network(writer: Writer, readout: NetworkReadout, inputs: Inputs) -> Answer:
    """Scaled features to forces, place, and what the readout knows of its errors."""
    forces = _layers(writer, readout.network, inputs.scaled) * readout.output_scale_n
    total, spread = forces.cast(np.float64).sum(), readout.spread
    unlike = writer.constant(np.float32(UNKNOWN))
    return Answer(
        forces.reshape(readout.bins.rows, readout.bins.cols),
        writer.concat(_place(forces, readout.bins), total),
        writer.constant(np.float32(UNKNOWN)),
        hypot(total * spread.share, spread.floor_n),
        _unlikeness(readout.likeness, inputs.scaled) if readout.likeness else unlike,
    )


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
    whole = centred @ centred
    left, size = ((each / likeness.mean.size).sqrt() for each in ((whole - known @ known).most(0), whole))
    return left / (likeness.floor + likeness.share * size)
