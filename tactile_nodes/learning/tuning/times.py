"""CPU time of whole frames, from image to force, for several configurations in turn on the same images.

Compiled loops are used if numba can compile them, as in the nodes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import cv2
import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import size_of_crop
from tactile_nodes.sensing.compiling import can_compile
from tactile_nodes.sensing.explain.model import ForceEstimator, ForceModel
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.shapes import UInt8

ROUNDS = 7
WARM_UP = 1


class _Frames:
    """One configuration with its rest image set."""

    def __init__(self, model: ForceModel, config: TrainConfig, images: Sequence[np.ndarray], *, compiled: bool) -> None:
        size = size_of_crop(config.data.crop)
        rest, *self._pressed = (np.ascontiguousarray(centre_crop(image, *size)) for image in images)
        self._flow = make_flow(config.flow.name, config.flow.options, compiled=compiled)
        self._encoding, self._estimator = config.make_encoding(), ForceEstimator(model, compiled=compiled)
        self._flow.set_reference(rest)
        self._encoding.set_reference(rest)

    def times_ms(self) -> list[float]:
        """CPU time of each image."""
        taken = []
        for image in self._pressed:
            begun = time.process_time_ns()
            self._estimator.predict(self._encoding.encode(self._flow.displacement(image)))
            taken.append((time.process_time_ns() - begun) / 1e6)
        return taken


def cpu_times_ms(
    configurations: Sequence[tuple[ForceModel, TrainConfig]],
    images: Sequence[UInt8[np.ndarray, 'h w']],
    progress: Progress,
) -> list[float]:
    """Median CPU time of a frame, for each configuration. The first image shows the gel at rest.

    Every round runs all configurations, alternately forwards and backwards, so that the machine's load affects all
    alike. CPU time of other threads counts too: run with OPENBLAS_NUM_THREADS=1 as the live node does.

    Raises:
        DatasetError: there is no image of a press.
    """
    if len(images) < 2:
        raise DatasetError('there is no image of a press to measure times with; give bags that hold some')
    cv2.setNumThreads(1)
    compiled = can_compile()
    contenders = [_Frames(model, config, images, compiled=compiled) for model, config in configurations]
    taken: list[list[float]] = [[] for _ in contenders]
    with progress.bar('taking times', ROUNDS + WARM_UP) as bar:
        for number in range(ROUNDS + WARM_UP):
            for place in range(len(contenders))[:: 1 if number % 2 else -1]:
                times = contenders[place].times_ms()
                taken[place] += times if number >= WARM_UP else []
            bar.advance()
    return [float(np.median(each)) for each in taken]
