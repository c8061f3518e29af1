"""The highest frame rate of flow features and force estimator without a lost frame, on one core, from memory."""

from __future__ import annotations

import math
import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.latency.pictures import pressed_pictures
from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.runtime import run_until, settle
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.messages import stamp_ns
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Publisher
    from tactile_nodes.learning.progress import Progress

KINDS = {'in contact': 1, 'mixed': 2}
"""One in this number of frames has contact."""
REST_FRAMES, IMAGES = 8, 32
WARM_UP, ANSWERS_WITHIN_S, SETTLES_NS = 20, 2.0, NS_PER_S // 5
TRIES = 3
"""Attempts per rate, because other work may occupy the core for longer than a frame."""


@dataclass(frozen=True)
class Held:
    """The highest rate without a lost frame (0: none), and the next rate, which failed.

    Also the latency from stamp to force, and the CPU time per frame including its publishing, at that rate.
    """

    rate_hz: int
    p99_ms: float
    cpu_ms: float
    next_hz: int | None


def highest(model: str, compiled: bool, rates: Sequence[int], seconds: float, progress: Progress) -> dict[str, Held]:
    """Measure the highest rate by kind of frames, each in a separate process on one core."""
    found = {}
    with progress.bar(f'rates of {model}{", compiled" if compiled else ""}', len(KINDS)) as bar:
        for kind, every in KINDS.items():
            with multiprocessing.get_context('spawn').Pool(1) as pool:
                found[kind] = pool.apply(_highest, (model, compiled, list(rates), seconds, every))
            bar.advance(1, f'{kind}: {found[kind].rate_hz} Hz')
    return found


def _highest(model: str, compiled: bool, rates: list[int], seconds: float, every: int) -> Held:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    rests = REST_FRAMES + WARM_UP
    pictures = pressed_pictures(load_model(find_model(model)).image_size[0], rests, IMAGES, every)
    bus, done = InProcessBus(), threading.Event()
    words = [f'model:={model}', f'compiled:={str(compiled).lower()}']
    given = parse_arguments(['--ros-args', *(word for each in words for word in ('-p', each)),
                             '-p', f'reference_frames:={REST_FRAMES}'])  # fmt: skip
    nodes = [FlowFeaturesNode(bus, given), ForceEstimatorNode(bus, given)]
    forces = bus.subscribe('/force_distribution', topics.FORCE_DISTRIBUTION.type_name, Qos('queue', 100_000))
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos())
    spinning = threading.Thread(target=run_until, args=(nodes, done))
    spinning.start()
    try:
        _feed(camera, pictures[:rests], 50)
        settle()
        held = Held(0, math.nan, math.nan, rates[0])
        for number, rate in enumerate(rates):
            tries = (_tried(camera, forces, pictures[rests:], rate, round(rate * seconds)) for _ in range(TRIES))
            dropped, p99_ms, cpu_ms = next((each for each in tries if not each[0]), (1, math.nan, math.nan))
            if dropped:
                return replace(held, next_hz=rate)
            held = Held(rate, p99_ms, cpu_ms, rates[number + 1] if number + 1 < len(rates) else None)
        return held
    finally:
        done.set()
        spinning.join()
        bus.close()


def _tried(
    camera: Publisher, forces: Subscription, pictures: Sequence[np.ndarray], rate: int, count: int
) -> tuple[int, float, float]:
    """Number of `count` images without a force; latency from stamp to force (p99) and CPU time per frame (ms)."""
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + SETTLES_NS)
    while forces.take() is not None:
        pass
    begun_ns = time.process_time_ns()
    _feed(camera, [pictures[i % len(pictures)] for i in range(count)], rate)
    late_ms: list[float] = []
    while len(late_ms) < count and (received := forces.get(ANSWERS_WITHIN_S)) is not None:
        late_ms.append((received.source_ns - stamp_ns(received.message.header.stamp)) / 1e6)
    cpu_ms = (time.process_time_ns() - begun_ns) / 1e6 / count
    return count - len(late_ms), float(np.percentile(late_ms or [math.nan], 99)), cpu_ms


def _feed(camera: Publisher, pictures: Sequence[np.ndarray], rate: int) -> None:
    """Publish pictures at their times; a late one is published at once, and later ones keep their times."""
    clock = SystemClock()
    begun_ns = clock.now_ns()
    for number, picture in enumerate(pictures):
        due_ns = begun_ns + number * NS_PER_S // rate
        clock.sleep_until(due_ns)
        camera.publish(conversions.image_message(picture, conversions.header(clock.now_ns(), 'camera')))
