"""The shipped models on the chart's test frames: errors, the cost of each stage, and of basic operations.

The models run in turn, ten frames at a time, because a sensor measures frames in sequence; in NumPy, and with compiled
loops if numba is installed. The camera's picture (JPEG, 640x480) is decoded once per frame and timed separately.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from benchmarks import PROFILES
from benchmarks.front.chains import measure_chains
from benchmarks.front.contenders import one_thread
from benchmarks.front.frames import SIDE, Frame, Plan, frames
from benchmarks.harness.report import in_turn, quartiles
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.sensing.compiling import can_compile
from tactile_nodes.sensing.explain.model import ForceEstimator
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

JPEG_QUALITY, SMALLER_QUALITY = 90, 75
STAGES = ('flow', 'features', 'predict')
TURN = 10
JPEG = 'JPEG 640x480 to grey'


@dataclass
class Profile:
    """A shipped model in use: CPU times (ms) by stage for each frame, and its estimates."""

    name: str
    loaded: LoadedModel
    flow: FlowMethod
    compiled: bool = False
    times_ms: list[tuple[float, ...]] = field(default_factory=list)
    answers: list[np.ndarray] = field(default_factory=list)
    rest: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.encoding = make_encoding(*self.loaded.encoding)
        self.estimator = ForceEstimator(self.loaded.model, compiled=self.compiled)

    def use_reference(self, rest: np.ndarray) -> None:
        """Set a new rest image, and compute everything that does not depend on a frame."""
        if rest is self.rest:
            return
        self.rest = rest
        self.flow.set_reference(rest)
        self.encoding.set_reference(rest)
        self.estimator.predict(self.encoding.encode(self.flow.displacement(rest)))

    def take(self, image: np.ndarray) -> None:
        """Process one frame."""
        stamps = [time.process_time_ns()]
        displacement = self.flow.displacement(image)
        stamps.append(time.process_time_ns())
        features = self.encoding.encode(displacement)
        stamps.append(time.process_time_ns())
        answer = self.estimator.predict(features).normal_force_n
        stamps.append(time.process_time_ns())
        self.times_ms.append(tuple(np.diff(stamps) * 1e-6))
        self.answers.append(answer.reshape(-1))


def profiles(compiled: bool) -> list[Profile]:
    """The profiles to measure, also with compiled loops if requested and numba is installed."""
    compiled = compiled and can_compile()
    made = []
    for name in PROFILES:
        loaded = load_model(find_model(name))
        made.append(Profile(name, loaded, make_flow(*loaded.flow)))
        if name != 'paper' and compiled:
            made.append(Profile(f'{name}, compiled', loaded, make_flow(*loaded.flow, compiled=True), compiled=True))
    return made


def measure_profiles(plan: Plan, progress: Progress) -> dict[str, Any]:
    """Scores and times of all profiles on the test frames of the contenders, and times of basic operations."""
    one_thread()
    taking_part = profiles(plan.compiled)
    others: dict[str, list[float]] = {name: [] for name in _FLOORS}
    turns = _turns(plan)
    with progress.bar('the models that ship', len(turns)) as bar:
        for number, turn in enumerate(turns):
            for each in in_turn(taking_part, number):
                each.use_reference(turn[0].rest)
                for frame in turn:
                    each.take(frame.image)
            for frame in turn:
                _take_floors(others, frame.image, frame.rest)
            bar.advance()
    known = np.array([frame.press for turn in turns for frame in turn], np.float32)
    models = [(each.name.partition(',')[0], each.compiled) for each in taking_part]
    chains = measure_chains(models, plan, progress)
    return {
        'profiles': {
            each.name: {**_entry(each, known), 'chain_cpu_ms': chain}
            for each, chain in zip(taking_part, chains, strict=True)
        },
        'floors_cpu_ms': {name: float(np.median(values)) for name, values in others.items()},
    }


def _turns(plan: Plan) -> list[list[Frame]]:
    """The test frames in groups of ten with the same rest image."""
    same_rest = (list(group) for _, group in itertools.groupby(frames(plan, tested_only=True), key=_rest_of))
    return [group[start : start + TURN] for group in same_rest for start in range(0, len(group), TURN)]


def _rest_of(frame: Frame) -> int:
    return id(frame.rest)


_FLOORS: Mapping[str, Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], object]] = {
    JPEG: lambda _image, _rest, data, _smaller: cv2.imdecode(data, cv2.IMREAD_GRAYSCALE),
    'JPEG 640x480 to grey at half size': lambda _image, _rest, data, _smaller: cv2.imdecode(
        data, cv2.IMREAD_REDUCED_GRAYSCALE_2
    ),
    'JPEG 640x480 to grey at an eighth: its codes, and next to no pixels': lambda _image, _rest, data, _smaller: (
        cv2.imdecode(data, cv2.IMREAD_REDUCED_GRAYSCALE_8)
    ),
    f'JPEG of quality {SMALLER_QUALITY} (the others: {JPEG_QUALITY}) to grey': lambda _image, _rest, _data, smaller: (
        cv2.imdecode(smaller, cv2.IMREAD_GRAYSCALE)
    ),
    'reading 440x440 bytes once': lambda image, *_others: cv2.sumElems(image),
    'one pass of arithmetic: the difference from the rest image, squared and summed': lambda image, rest, *_data: (
        cv2.norm(image, rest, cv2.NORM_L2SQR)
    ),
}


def _take_floors(others: dict[str, list[float]], image: np.ndarray, rest: np.ndarray) -> None:
    picture = np.zeros((480, 640), np.uint8)
    picture[20 : 20 + SIDE, 100 : 100 + SIDE] = image
    data, smaller = (
        cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        for quality in (JPEG_QUALITY, SMALLER_QUALITY)
    )
    for name, work in _FLOORS.items():
        begun = time.process_time_ns()
        work(image, rest, data, smaller)
        others[name].append((time.process_time_ns() - begun) * 1e-6)


def _entry(profile: Profile, presses: np.ndarray) -> dict[str, Any]:
    touched = presses[:, 2] > 0
    times = np.array(profile.times_ms)[touched]
    whole = times.sum(axis=1)
    bins = profile.loaded.model.bins
    truth = Dataset(np.zeros(0), presses, np.zeros(0), np.zeros(0), '').labels(bins)
    scores = Validation.of(truth, np.stack(profile.answers).astype(np.float32), bins)
    return {
        'cpu_ms': quartiles(whole),
        'stages_cpu_ms': dict(zip(STAGES, np.median(times, axis=0).tolist(), strict=True)),
        'armse_n': scores.armse_n,
        'd_loc_mm': scores.d_loc_mm,
        'rmse_mc_n': scores.rmse_mc_n,
    }
