"""The queue of lines in a motion controller: started one after the other, held, dropped."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tactile_nodes.emulators.motion import Segment, Vector, length, limited, line, plus
from tactile_nodes.emulators.world import World


@dataclass(frozen=True)
class Block:
    """A line to a target in the world's coordinates, no faster than the axes allow."""

    target: Vector
    feed_mm_s: float
    rates_mm_s: Vector
    acceleration: Vector


class Planner:
    """Executes blocks in the world. `step` must be called exactly at `next_event_ns`: the next block starts then."""

    def __init__(self, world: World, capacity: int) -> None:
        self._world = world
        self._queue: deque[Block] = deque()
        self._current: Block | None = None
        self._segment: Segment | None = None
        self._end_ns = 0
        self.capacity = capacity
        self.held = False

    @property
    def used(self) -> int:
        return len(self._queue) + (self._current is not None)

    @property
    def segment(self) -> Segment | None:
        return self._segment if self._current is not None else None

    def target(self, now_ns: int) -> Vector:
        last = self._queue[-1] if self._queue else self._current
        return last.target if last is not None else self._world.motor_at(now_ns)

    def at_rest(self, now_ns: int) -> bool:
        return self._current is None or now_ns >= self._end_ns

    def add(self, block: Block, now_ns: int) -> bool:
        """Queue a block, and start it if none is in progress; False: it has no length."""
        if length(plus(block.target, self.target(now_ns), -1.0)) < 1e-6:
            return False
        self._queue.append(block)
        self.step(now_ns)
        return True

    def step(self, now_ns: int) -> None:
        """Remove a block that has ended, and start the next one."""
        if self.held:
            return
        if self._current is not None and now_ns >= self._end_ns:
            self._current = None
        if self._current is None and self._queue:
            self._start(self._queue.popleft(), now_ns)

    def next_event_ns(self, now_ns: int) -> int | None:
        """When the block in progress ends; None: nothing moves."""
        return self._end_ns if self._current is not None and now_ns < self._end_ns else None

    def hold(self, now_ns: int) -> None:
        """Decelerate to rest along the line, and stay there."""
        if self._current is not None and not self.held and self._segment is not None:
            self._end_ns = self._world.brake(now_ns, limited(self._segment.unit, self._current.acceleration))
        self.held = True

    def flush(self, now_ns: int) -> None:
        """Drop all blocks; motion stops at once."""
        self._world.brake(now_ns)
        self._queue.clear()
        self._current, self._segment, self._end_ns = None, None, now_ns
        self.held = False

    def drop_queue(self) -> None:
        self._queue.clear()

    def _start(self, block: Block, now_ns: int) -> None:
        start = self._world.motor_at(now_ns)
        way = plus(block.target, start, -1.0)
        fastest = limited(way, block.rates_mm_s) * length(way) if length(way) else 1.0
        feed = min(block.feed_mm_s, fastest)
        self._segment = line(now_ns, start, block.target, feed, block.acceleration)
        self._world.move(self._segment)
        self._current, self._end_ns = block, self._segment.end_ns
