"""What belongs to one initialisation: a participant in a domain."""

from __future__ import annotations

import os
from functools import cache
from typing import Any


class Context:
    def __init__(self) -> None:
        self.args: list[str] | None = None
        self.domain_id = 0
        self._ok = False
        self._nodes: list[Any] = []

    def init(self, args: list[str] | None = None, *, domain_id: int | None = None) -> None:
        if self.args is not None:
            raise RuntimeError('Context.init() must only be called once')
        self.args = list(args or [])
        self.domain_id = int(os.environ.get('ROS_DOMAIN_ID', '0')) if domain_id is None else domain_id
        self._ok = True

    def ok(self) -> bool:
        return self._ok

    def track_node(self, node: Any) -> None:
        self._nodes.append(node)

    def try_shutdown(self) -> None:
        if self._ok:
            self._ok = False
            for node in self._nodes:
                node.destroy_node()


@cache
def get_default_context() -> Context:
    return Context()
