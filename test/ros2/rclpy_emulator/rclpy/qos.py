"""Qualities of service, and which of them hear each other."""

from __future__ import annotations

from enum import IntEnum
from typing import Any


class HistoryPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2


class ReliabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class InvalidQoSProfileException(Exception):  # noqa: N818 - its name
    pass


class QoSProfile:
    """rclpy's refuses a profile that says neither history nor depth."""

    def __init__(self, **policies: Any) -> None:
        unknown = policies.keys() - {'history', 'depth', 'reliability', 'durability', 'lifespan', 'deadline'}
        assert not unknown, f'no policies of rclpy: {unknown}'
        if 'history' not in policies and 'depth' not in policies:
            raise InvalidQoSProfileException('History and/or depth settings are required.')
        self.history = HistoryPolicy(policies.get('history', HistoryPolicy.KEEP_LAST))
        if self.history == HistoryPolicy.KEEP_LAST and 'depth' not in policies:
            raise InvalidQoSProfileException('History set to KEEP_LAST without a depth setting.')
        self.depth = int(policies.get('depth', 0))
        self.reliability = ReliabilityPolicy(policies.get('reliability', ReliabilityPolicy.RELIABLE))
        self.durability = DurabilityPolicy(policies.get('durability', DurabilityPolicy.VOLATILE))
        self.lifespan = policies.get('lifespan')


def compatible(offered: QoSProfile, requested: QoSProfile) -> bool:
    """DDS's rule: nobody gets more than is offered."""
    return not (
        (requested.reliability == ReliabilityPolicy.RELIABLE and offered.reliability == ReliabilityPolicy.BEST_EFFORT)
        or (
            requested.durability == DurabilityPolicy.TRANSIENT_LOCAL and offered.durability == DurabilityPolicy.VOLATILE
        )
    )
