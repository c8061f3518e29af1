"""Finds the attempts of a plan that the bags hold completely, with message and images.

The journal holds what the rig sent to the recorder, but a power cut may come before it is on disk. So before a run
continues, every press that no bag has confirmed yet is searched for. If it is found complete, it is noted as verified,
even if the journal was cut off before that entry. If it is not found, it is done again, with a new attempt number. So
no press is lost or counted twice. An attempt that a later message marks as suspect does not count as found. The same
check runs after the last press of a plan: presses that fell between a killed recorder and the next one are done again.
"""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tactile_nodes import messages
from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE, Topic
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.plan.journal import MISSING, RECORDED, STARTED, VERIFIED, Entry, Journal
from tactile_nodes.errors import BagError, MessageError
from tactile_nodes.messages import types

SETTLE_S = 3.0  # a recorder writes within half a second, if the disk is fast enough
Attempt = tuple[int, int]
Wanted = Callable[[], None]
"""Called while a bag, which may be large, is read; raises if the search is to end."""


def always() -> None:
    """`Wanted` that lets a search go on to its end."""


def audit(journal: Journal, plan_id: str, folder: Path, now_ns: int, still_wanted: Wanted = always) -> tuple[int, int]:
    """Resolve open entries of the journal; returns how many presses were found in the bags, and how many were not."""
    return settle(journal, attempts_below(folder, plan_id, still_wanted), now_ns) if journal.unverified() else (0, 0)


def settle(journal: Journal, held: set[Attempt], now_ns: int) -> tuple[int, int]:
    """As `audit`; `held` are the attempts that the bags hold."""
    found: list[Entry] = []
    missing: list[Entry] = []
    for entry in journal.unverified():
        if (entry.press, entry.attempt) in held:
            found.append(Entry(entry.press, entry.attempt, VERIFIED, now_ns, 'found in the bag'))
        elif entry.step == RECORDED:
            missing.append(Entry(entry.press, entry.attempt, MISSING, now_ns, 'not found in any bag of the folder'))
        else:
            assert entry.step == STARTED
    journal.note_all([*found, *missing])
    return len(found), len(missing)


def await_recorded(
    journal: Journal, plan_id: str, folder: Path, clock: Clock, still_wanted: Wanted = always
) -> set[Attempt]:
    """The attempts of the plan in the bags, after a recorder had time to write the last ones."""
    recorded = {(entry.press, entry.attempt) for entry in journal.unverified() if entry.step == RECORDED}
    held, deadline_ns = attempts_below(folder, plan_id, still_wanted), clock.now_ns() + round(SETTLE_S * NS_PER_S)
    while not recorded <= held and clock.now_ns() < deadline_ns:
        clock.sleep_until(clock.now_ns() + NS_PER_S // 4)
        held = attempts_below(folder, plan_id, still_wanted)
    return held


def bags_below(folder: Path) -> list[Path]:
    """Every folder in this one that holds an .mcap file."""
    return sorted({file.parent for file in folder.glob('*/*.mcap')})


def attempts_below(folder: Path, plan_id: str, still_wanted: Wanted = always) -> set[Attempt]:
    """(press, attempt) of each press in the bags of a folder that was recorded with its images."""
    found = [presses_in(bag, plan_id, still_wanted) for bag in bags_below(folder)]
    suspects = set().union(*(suspect for _, suspect in found), set())
    return set().union(*(complete for complete, _ in found), set()) - suspects


def presses_in(bag: Path, plan_id: str, still_wanted: Wanted = always) -> tuple[set[Attempt], set[Attempt]]:
    """(press, attempt) of the presses in a bag that are complete, and of those that it marks as suspect."""
    try:
        with BagReader(bag) as reader:
            return _complete_presses(reader, plan_id, still_wanted)
    except BagError:  # a recording that has just started, or was cut off at its start
        return set(), set()


def topics_of(reader: BagReader) -> list[str]:
    """Topics of presses and their images, in any namespace."""
    return [name for name in reader.topics if is_topic(name, PRESS) or is_topic(name, PRESS_IMAGE)]


def messages_of(reader: BagReader, topics: list[str], still_wanted: Wanted) -> Iterator[BagMessage]:
    """The messages on these topics, as long as the search is wanted."""
    for found in reader.messages(topics):
        still_wanted()
        yield found


def _complete_presses(reader: BagReader, plan_id: str, still_wanted: Wanted) -> tuple[set[Attempt], set[Attempt]]:
    """Images and messages have separate queues, so the last image of a press may be received after its message."""
    presses: list[tuple[types.Press, str]] = []
    images: defaultdict[str, list[int]] = defaultdict(list)  # by namespace: a bag may hold several rigs
    for found in messages_of(reader, topics_of(reader), still_wanted):
        rig = found.topic.rpartition('/')[0]
        if is_topic(found.topic, PRESS_IMAGE):
            images[rig].append(found.publish_ns)
        elif (press := decoded(reader, found)) is not None and press.plan_id == plan_id:
            presses.append((press, rig))
    for stamps_ns in images.values():
        stamps_ns.sort()
    suspects = {(press.press, press.attempt) for press, _ in presses if press.status == types.Press.STATUS_SUSPECT}
    return {(press.press, press.attempt) for press, rig in presses if _is_complete(press, images[rig])}, suspects


def decoded(reader: BagReader, found: BagMessage) -> types.Press | None:
    """The press in a message; None if it is not a press."""
    try:
        press: types.Press = reader.decode(found)
    except MessageError:
        return None
    return press


def _is_complete(press: types.Press, images: Sequence[int]) -> bool:
    start_ns, end_ns = messages.stamp_ns(press.window_start), messages.stamp_ns(press.window_end)
    held = bisect.bisect_right(images, end_ns) - bisect.bisect_left(images, start_ns)
    return press.status == types.Press.STATUS_RECORDED and held >= press.frames


def is_topic(name: str, topic: Topic) -> bool:
    """Whether `name` is the topic in any namespace."""
    return name.rpartition('/')[2] == topic.name
