"""What a procedure (`press_cycle`, `feel_corner`) asks of the rig, and what it is told in return.

A procedure is a generator: it yields actions and is sent what was seen. So it reads from top to bottom, knows no
device, thread or clock, and a test feeds it times and values by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from tactile_nodes.collection.readings import Frame
from tactile_nodes.collection.wrench import Tare
from tactile_nodes.drivers.cnc.contract import Place, Switched
from tactile_nodes.drivers.force_torque.contract import Sample


@dataclass(frozen=True)
class Go:
    """Go to a place in machine coordinates (None: stay as it is), and come to rest there.

    `expect` is asked on the way, whenever the machine has said where it is: with the place that it told the time before
    and what was felt since. What it answers is why to stop at once; empty: go on.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    feed_mm_min: float = 60.0
    expect: Callable[[Place, Sequence[Sample]], str] | None = None


@dataclass(frozen=True)
class Look:
    """Wait, and say what was measured since `since_ns`, or since the wait began (None).

    What is measured arrives later: whoever gathers over several looks asks since the same time again and again.
    """

    seconds: float
    since_ns: int | None = None


@dataclass(frozen=True)
class SetTare:
    """Take the force from now on as the change since this."""

    tare: Tare


@dataclass(frozen=True)
class Switch:
    """Switch the digital line."""

    level: bool


Action = Go | Look | SetTare | Switch


@dataclass(frozen=True)
class Seen:
    """What is known when an action is done.

    Attributes:
        now_ns: the time.
        since_ns: when the action began, at which the machine was at rest.
        place_mm: where the machine said that the tip is.
        samples: of a `Look`, the force samples that it asked for.
        frames: of a `Look`, likewise the images.
        switched: of a `Switch`, when the line got its level.
    """

    now_ns: int
    since_ns: int
    place_mm: Place
    samples: tuple[Sample, ...] = ()
    frames: tuple[Frame, ...] = ()
    switched: Switched | None = None


Result = TypeVar('Result')
Procedure = Generator[Action, Seen, Result]
