"""Runs an exported model, as a robot does that uses ONNX instead of numpy."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_nodes.errors import from_extra
from tactile_nodes.shapes import Float32

OUTPUTS = 'normal_force', 'contact', 'position_sigma', 'total_sigma', 'unlikeness', 'seen'


class OnnxSession:
    """An ONNX file's content, run by onnxruntime in one thread of the CPU.

    Raises:
        ConfigurationError: onnxruntime is not installed.
    """

    def __init__(self, content: bytes) -> None:
        with from_extra('onnx', 'running ONNX files'):
            import onnxruntime
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session: Any = onnxruntime.InferenceSession(content, options, providers=['CPUExecutionProvider'])

    def answer(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> dict[str, np.ndarray]:
        """The graph's outputs by name."""
        found = self._session.run(OUTPUTS, {'features': values[None], 'confidence': confidence})
        return dict(zip(OUTPUTS, found, strict=True))
