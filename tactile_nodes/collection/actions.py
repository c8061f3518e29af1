"""The actions that a procedure (`press_cycle`, `feel_corner`) requests from the rig, and the results it receives.

A procedure is a generator: it yields actions and is sent the results. So it reads from top to bottom, and knows no
device, thread or clock. A test can send it times and values directly.
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
    """Go to a position in machine coordinates (None: keep the coordinate), and come to rest there.

    `expect` is called on the way, whenever the machine has reported its position. It gets the position that was
    reported before that, and the samples since. It returns the reason to stop at once, or an empty string.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    feed_mm_min: float = 60.0
    expect: Callable[[Place, Sequence[Sample]], str] | None = None


@dataclass(frozen=True)
class Look:
    """Wait, and return what was measured since `since_ns`, or since the wait began (None).

    Measurements arrive with a delay. To collect them over several looks, use the same `since_ns` each time.
    """

    seconds: float
    since_ns: int | None = None


@dataclass(frozen=True)
class SetTare:
    """Measure the force from now on as the change since this value."""

    tare: Tare


@dataclass(frozen=True)
class Switch:
    """Switch the digital line."""

    level: bool


Action = Go | Look | SetTare | Switch


@dataclass(frozen=True)
class Observation:
    """The result of an action.

    Attributes:
        now_ns: the time when it was done.
        since_ns: when the action began; the machine was at rest then.
        place_mm: position of the tip that the machine reported.
        samples: after a `Look`: the requested force samples.
        frames: after a `Look`: the requested images.
        switched: after a `Switch`: when the line changed its level.
    """

    now_ns: int
    since_ns: int
    place_mm: Place
    samples: tuple[Sample, ...] = ()
    frames: tuple[Frame, ...] = ()
    switched: Switched | None = None


Result = TypeVar('Result')
Procedure = Generator[Action, Observation, Result]
