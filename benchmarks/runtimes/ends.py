"""The processes of the benchmark of runtimes: each runs one model in one runtime, in turn.

Before its runtime, a process imports what the live node needs anyway, so only the rest counts for the runtime.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import psutil

from benchmarks.harness.workers import Worker, asked
from tactile_nodes.clock import perf_ns
from tactile_nodes.model_file import load_model
from tactile_nodes.sensing.explain.model import ForceEstimator
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.features import Features

Answer = Callable[[Features], np.ndarray]
"""From one frame to the force on each bin."""
LONGEST_S = 120.0


class Runtime(Worker):
    """One of the processes; `began` holds start time and memory of the runtime."""

    def __init__(self, runtime: str, model: Path, exported: Path, frames: list[Features]) -> None:
        super().__init__(_serve, runtime, model, exported)
        self.began: dict[str, float] = self.ask(frames, LONGEST_S)

    def turn(self, first: int, count: int) -> tuple[float, float]:
        """Median time and mean CPU time of a frame in ms, over `count` frames from the `first` on."""
        wall_ms, cpu_ms = self.ask((first, count), LONGEST_S)
        return wall_ms, cpu_ms


def _serve(pipe: Connection, runtime: str, model: Path, exported: Path) -> None:
    frames: list[Features] = pipe.recv()
    before, begun = _memory_mb(), perf_ns()
    answer = BEGIN[runtime](model, exported)
    answer(frames[0])
    began_s = (perf_ns() - begun) / 1e9
    pipe.send({'start_s': began_s, 'memory_mb': _memory_mb() - before, 'memory_before_mb': before})
    for first, count in asked(pipe):
        pipe.send(_turn(answer, [frames[(first + i) % len(frames)] for i in range(count)]))


def _turn(answer: Answer, frames: list[Features]) -> tuple[float, float]:
    times, cpu = [], time.process_time_ns()
    for frame in frames:
        begun = perf_ns()
        answer(frame)
        times.append(perf_ns() - begun)
    return float(np.median(times)) / 1e6, (time.process_time_ns() - cpu) / 1e6 / len(frames)


def _memory_mb() -> float:
    return float(psutil.Process().memory_info().rss) / 1e6


def _numpy(model: Path, exported: Path) -> Answer:
    del exported
    estimator = ForceEstimator(load_model(model).model)
    return lambda frame: estimator.predict(frame).normal_force_n


def _onnxruntime(model: Path, exported: Path) -> Answer:
    from tactile_nodes.learning.onnx_files.check import OnnxSession

    del model
    session = OnnxSession(exported.read_bytes())
    return lambda frame: session.answer(frame.values, frame.confidence)['normal_force']


def _torch(model: Path, exported: Path) -> Answer:
    """The network alone, without place, uncertainty and novelty."""
    import torch

    del exported
    torch.set_num_threads(1)
    readout = load_model(model).model.readout
    assert isinstance(readout, NetworkReadout)
    assert readout.layer is None  # shipped models have none
    scaling, shape = readout.scaling, (readout.bins.rows, readout.bins.cols)
    mean, gain, trusted = (torch.from_numpy(each) for each in (scaling.mean, scaling.gain, scaling.trusted))
    layers = [
        (torch.from_numpy(w), torch.from_numpy(b))
        for w, b in zip(readout.network.weights, readout.network.biases, strict=True)
    ]
    hidden = {'logistic': torch.sigmoid, 'relu': torch.relu}[readout.network.hidden]

    @torch.inference_mode()
    def answer(frame: Features) -> np.ndarray:
        used = trusted * (torch.from_numpy(frame.confidence) >= scaling.confidence_floor)
        values = ((torch.from_numpy(frame.values) - mean) * gain * used[..., None]).reshape(-1)
        for weight, bias in layers[:-1]:
            values = hidden(torch.nn.functional.linear(values, weight, bias))
        forces = torch.nn.functional.linear(values, *layers[-1]) * readout.output_scale_n
        found: np.ndarray = forces.reshape(shape).numpy()
        return found

    return answer


BEGIN: dict[str, Callable[[Path, Path], Answer]] = {'numpy': _numpy, 'onnxruntime': _onnxruntime, 'torch': _torch}
"""By name: from a model's file and its export to the function that estimates forces."""
