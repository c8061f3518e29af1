"""A program that collects in simulated time into real bags, to be killed: ``collecting.py FOLDER BAG[:WHERE:PRESS] …``.

Each BAG is a run in a process of its own. WHERE is where it kills itself with SIGKILL at that press (counted from 1):
`started`, `bag` (the bag has it on the disk, the journal does not) or `journal` (the journal has it, and nothing that
the bag was given since is on the disk). Prints how each process ended.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from rehearsing import SAFE_Z_MM, Dots, Run, changed

from tactile_nodes import conversions, messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.collection.plan.audit import audit
from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.run.recall import recalled
from tactile_nodes.collection.run.run_messages import press_message, suspect_message

TOPICS = {'/press': 'tactile_nodes/msg/Press', '/press_image': 'sensor_msgs/msg/Image'}


def main(folder: Path, name: str, where: str = '', at: int = 0) -> None:
    run = Run(folder, changed(anchor={'every': 3}), dots=Dots())
    audit(run.journal, run.plan.plan_id, folder, 0)
    run.campaign.progress.done = run.journal.done
    writer = BagWriter(folder / name)
    for topic, type_name in TOPICS.items():
        writer.add_topic(BagTopic.of_type(topic, type_name))
    published = 0

    def record(record: Record) -> None:
        nonlocal published
        published += 1
        if where == 'started' and published == at:
            die()
        if where == 'journal' and published == at:
            return  # as if it waited in the recorder's memory
        write(writer, run, record)
        if where == 'bag' and published == at:
            writer.close()
            die()

    def die_after_the_journal(press: int, attempt: int, step: str, stamp_ns: int, reason: str = '') -> None:
        note(press, attempt, step, stamp_ns, reason)
        if where == 'journal' and step == 'recorded' and published == at:
            die()

    note = run.journal.note
    run.journal.note = die_after_the_journal  # type: ignore[method-assign]
    outlet = run.campaign._outlet
    object.__setattr__(outlet, 'record', record)
    object.__setattr__(outlet, 'suspect', lambda entry, reason: doubt(writer, run, entry, reason))
    object.__setattr__(outlet, 'recall', lambda entry: recalled(folder, run.plan.plan_id, entry))
    run.campaign.run()
    assert abs(run.height_mm - SAFE_Z_MM) < 0.01
    writer.close()


def write(writer: BagWriter, run: Run, record: Record) -> None:
    now_ns = run.rig.clock.now_ns()
    for frame in (*record.rest, *record.frames):
        image = conversions.image_message(frame.image, conversions.header(frame.stamp_ns, 'camera'))
        # Images travel by another way than messages: the last one comes in later.
        writer.write(
            '/press_image', messages.encode(image), now_ns + (2000 if frame is record.frames[-1] else 0), now_ns
        )
    press = press_message(record, run.plan.plan_id, 'tip', 'gel_surface')
    writer.write('/press', messages.encode(press), now_ns + 1000, now_ns)


def doubt(writer: BagWriter, run: Run, entry: Entry, reason: str) -> None:
    now_ns = run.rig.clock.now_ns()
    message = suspect_message(entry, run.plan.plan_id, reason, now_ns, 'gel_surface')
    writer.write('/press', messages.encode(message), now_ns, now_ns)


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def in_a_process(folder: Path, name: str, where: str = '', at: str = '0') -> int:
    """How it ended: 0, or minus the signal."""
    child = os.fork()
    if child == 0:
        main(folder, name, where, int(at))
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == '__main__':
    for run in sys.argv[2:]:
        print(in_a_process(Path(sys.argv[1]), *run.split(':')), flush=True)
