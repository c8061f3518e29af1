"""The functions by which a run reports results and asks questions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run.person import Person


@dataclass(frozen=True)
class Outlet:
    """The interface of a run to the outside.

    Attributes:
        record: an attempt has ended; returns when it was sent to the recorder.
        rest_image: a new rest image, and the stamp of its last frame.
        say: a line for a person.
        require_recorder: whether a recorder is running; raises if there was none for too long.
        person: asks a person to check the rig.
        missing: checks the bags for recorded presses, and returns how many it has marked as to be done again.
        suspect: a recorded attempt was perhaps not at its place, and why.
        recall: the recorded attempt of an entry, with its images; None if they no longer exist.
    """

    record: Callable[[Record], None]
    rest_image: Callable[[Picture, int], None]
    say: Callable[[str], None]
    require_recorder: Callable[[], bool]
    suspect: Callable[[Entry, str], None]
    recall: Callable[[Entry], Record | None]
    missing: Callable[[], int]
    person: Person
