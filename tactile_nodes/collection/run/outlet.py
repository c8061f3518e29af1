"""Whom a run tells what it does, and whom it asks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run.person import Person


@dataclass(frozen=True)
class Outlet:
    """The world outside of a run.

    Attributes:
        record: an attempt is over; returns when it is on its way to the recorder.
        rest_image: a new one, and the stamp of its last frame.
        say: a line for a person.
        require_recorder: whether somebody records; raises when nobody has done so for too long.
        person: who has to look when only a person can tell.
        missing: looks for what was recorded in the bags, and says how many presses it has marked as to be done again.
        suspect: an attempt that was recorded was perhaps not at its place, and why.
        recall: the attempt of an entry as it was recorded, with its images; None where they are no more.
    """

    record: Callable[[Record], None]
    rest_image: Callable[[Picture, int], None]
    say: Callable[[str], None]
    require_recorder: Callable[[], bool]
    suspect: Callable[[Entry, str], None]
    recall: Callable[[Entry], Record | None]
    missing: Callable[[], int]
    person: Person
