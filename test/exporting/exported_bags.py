"""A small bag of a sensor and a robot, and what is in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, IMAGE, PRESS, WRENCH
from tactile_nodes.collection.plan.journal import RECORDED, Entry
from tactile_nodes.collection.run.run_messages import suspect_message
from tactile_nodes.conversions import header, image_message, wrench_message
from tactile_nodes.messages import types

START_NS = 1_700_000_000_000_000_000
STEP_NS = 16_666_667
JOINTS = '/joint_states'


def force(number: int, stamp_ns: int) -> types.ForceDistribution:
    """A message with numbers that 32 bits do not hold; the first says that it is invalid, the second touches."""
    values = np.random.default_rng(number).normal(size=81).astype(np.float32)
    touches = number != 1
    contact = types.Contact(
        position=types.Point(x=1e-3 / 3, y=-2e-3), position_sigma=1e-4 / 3, force=0.1, force_sigma=0.01
    )
    return types.ForceDistribution(
        header=header(stamp_ns, 'gel_surface'), rows=9, cols=9, bin_width=0.0025, bin_height=0.0025,
        origin=types.Point(x=-0.01125, y=-0.01125), normal_force=values, total=float(values.sum(dtype=np.float64)) / 3,
        total_sigma=0.01 / 3 if touches else float('nan'), peak=float(values.max()), in_contact=touches,
        contact=contact.position if touches else types.Point(x=float('nan'), y=float('nan'), z=float('nan')),
        contacts=[contact] if touches else [], unlikeness=0.5, status=2 if number == 0 else 0,
        reasons=8 if number == 0 else 0,
        provenance=types.Provenance(model='fast', model_id='a1b2c3d4e5f6', calibration_id='0123456789ab', gel='gel7'),
    )  # fmt: skip


def picture(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (12, 16), dtype=np.uint8)


def write_messages(folder: Path, *received: tuple[str, Any, int]) -> Path:
    """A bag of messages, each with its topic and when it was received."""
    writer = BagWriter(folder)
    for topic, message in {topic: message for topic, message, _ in received}.items():
        writer.add_topic(BagTopic.of_type(topic, message.__msgtype__))
    for topic, message, at_ns in received:
        writer.write(topic, messages.encode(message), at_ns, START_NS)
    writer.close()
    return folder


def write_bag(folder: Path, frames: int = 30, joint_names: Sequence[str] = ('a', 'b')) -> list[types.ForceDistribution]:
    """Forces, wrenches and pictures 60 times a second; joints at a third of that, from the fourth frame on."""
    writer = BagWriter(folder)
    for topic in (FORCE_DISTRIBUTION, WRENCH, IMAGE):
        writer.add_topic(BagTopic.of_type(f'/{topic.name}', topic.type_name))
    writer.add_topic(BagTopic.of_type(JOINTS, 'sensor_msgs/msg/JointState'))
    made = []
    for number in range(frames):
        stamp_ns = START_NS + number * STEP_NS
        message = force(number, stamp_ns)
        made.append(message)
        _write(writer, f'/{FORCE_DISTRIBUTION.name}', message, 9_000_000)
        _write(writer, f'/{WRENCH.name}', wrench_message(message), 9_500_000)
        _write(writer, f'/{IMAGE.name}', image_message(picture(number), header(stamp_ns, 'camera')), 3_000_000)
        if number >= 3 and number % 3 == 0:
            joints = types.JointState(
                header=header(stamp_ns - 1_000_000, 'base'), name=[*joint_names], position=np.array([number / 3, 0.1])
            )
            _write(writer, JOINTS, joints, 2_000_000)
    writer.close()
    return made


def write_presses(
    folder: Path, suspect: int = 0, rigs: tuple[str, ...] = (f'/{PRESS.name}',), *, first: int = 0
) -> None:
    """Sixty forces, of which the `first` are lost, with presses whose windows end with the 20th and the 40th; the
    second one was rejected.

    They are presses 1 and 2 of one rig, or press 1 of one rig started twice, or of each of two rigs at once.

    At the end, as a rig does it, one that is `suspect` is called so.
    """
    writer = BagWriter(folder)
    writer.add_topic(BagTopic.of_type(f'/{FORCE_DISTRIBUTION.name}', FORCE_DISTRIBUTION.type_name))
    for rig in dict.fromkeys(rigs):
        writer.add_topic(BagTopic.of_type(rig, PRESS.type_name))
    for number in range(60):
        if number >= first:
            _write(writer, f'/{FORCE_DISTRIBUTION.name}', force(number, START_NS + number * STEP_NS), 9_000_000)
        if number in (19, 39):
            start_ns, end_ns = START_NS + (number - 3) * STEP_NS, START_NS + number * STEP_NS
            place = number // 20 + 1 if len(rigs) == 1 else 1
            press = types.Press(
                header=header(start_ns, 'gel_surface'), plan_id='a1b2c3d4e5f6', press=place, attempt=1,
                window_start=messages.time_from_ns(start_ns), window_end=messages.time_from_ns(end_ns),
                status=number // 20, reason='the force drifted' if number == 39 else '',
            )  # fmt: skip
            for rig in dict.fromkeys(rigs):
                _write(writer, rig, press, 4 * STEP_NS)
    if suspect:
        entry = Entry(suspect, 1, RECORDED, 0)
        last_ns = START_NS + 60 * STEP_NS
        message = suspect_message(entry, 'a1b2c3d4e5f6', 'the anchor lies beside', last_ns, 'gel_surface')
        _write(writer, f'/{PRESS.name}', message, 0)
    writer.close()


def _write(writer: BagWriter, topic: str, message, delay_ns: int) -> None:
    stamp_ns = messages.stamp_ns(message.header.stamp)
    writer.write(topic, messages.encode(message), stamp_ns + delay_ns, stamp_ns)
