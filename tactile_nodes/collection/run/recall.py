"""A press as an earlier run recorded it, with its images, read from the bags of a folder."""

from __future__ import annotations

import bisect
from pathlib import Path

from tactile_nodes import conversions, messages
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE
from tactile_nodes.collection.plan.audit import Wanted, always, bags_below, decoded, is_topic, messages_of, topics_of
from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.readings import Frame, frame_of
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types

REST_FRAMES = 5


def recalled(folder: Path, plan_id: str, entry: Entry, still_wanted: Wanted = always) -> Record | None:
    """The attempt of an entry; None if no bag of the folder holds it with images at rest and pressed."""
    for bag in bags_below(folder):
        try:
            with BagReader(bag) as reader:
                for topic in [name for name in topics_of(reader) if is_topic(name, PRESS)]:
                    found = _press(reader, topic, plan_id, entry, still_wanted)
                    record = _record(reader, topic, *found, still_wanted) if found is not None else None
                    if record is not None:
                        return record
        except BagError:  # it holds no readable data
            continue
    return None


def _press(
    reader: BagReader, topic: str, plan_id: str, entry: Entry, still_wanted: Wanted
) -> tuple[types.Press, int] | None:
    """The press, and the end time of the one before it."""
    wanted = (plan_id, entry.press, entry.attempt, types.Press.STATUS_RECORDED)
    before_ns = 0
    for found in messages_of(reader, [topic], still_wanted):
        press = decoded(reader, found)
        if press is None:
            continue
        if (press.plan_id, press.press, press.attempt, press.status) == wanted:
            return press, before_ns
        before_ns = max(before_ns, messages.stamp_ns(press.window_end))
    return None


def _record(reader: BagReader, topic: str, press: types.Press, before_ns: int, still_wanted: Wanted) -> Record | None:
    start_ns, end_ns = messages.stamp_ns(press.window_start), messages.stamp_ns(press.window_end)
    images = f'{topic.rpartition("/")[0]}/{PRESS_IMAGE.name}'  # of the same rig
    frames = _frames(reader, images, before_ns + 1, end_ns, still_wanted)
    within = bisect.bisect_left([frame.stamp_ns for frame in frames], start_ns)
    rest, window = frames[:within][-REST_FRAMES:], frames[within:]
    if not rest or not window:
        return None
    x_mm, y_mm, depth_mm = (1000 * value for value in (press.position.x, press.position.y, press.depth))
    force, torque = press.wrench.force, press.wrench.torque
    wrench = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
    point = Point(press.press, x_mm, y_mm, depth_mm)
    return Record(point, press.attempt, rest=rest, frames=window, wrench=wrench)


def _frames(reader: BagReader, topic: str, start_ns: int, end_ns: int, still_wanted: Wanted) -> list[Frame]:
    """Images by their stamps, which are the times of publishing in a bag; in order."""
    found = messages_of(reader, [topic], still_wanted)
    kept = [reader.decode(each) for each in found if start_ns <= each.publish_ns <= end_ns]
    frames = [frame_of(messages.stamp_ns(image.header.stamp), conversions.image_array(image)) for image in kept]
    return sorted(frames, key=lambda frame: frame.stamp_ns)
