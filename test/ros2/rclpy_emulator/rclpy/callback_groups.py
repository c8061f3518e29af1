"""Which callbacks may run while which others have not ended."""

from __future__ import annotations


class ReentrantCallbackGroup:
    def can_execute(self) -> bool:
        return True

    def begin(self) -> None:
        pass

    def end(self) -> None:
        pass


class MutuallyExclusiveCallbackGroup:
    """One at a time: also while it is a coroutine that waits."""

    def __init__(self) -> None:
        self._busy = False

    def can_execute(self) -> bool:
        return not self._busy

    def begin(self) -> None:
        self._busy = True

    def end(self) -> None:
        self._busy = False
