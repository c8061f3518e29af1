"""How a topic of ours is kept by DDS: `Qos` as rclpy's profiles, and where ROS 2 has customs of its own."""

from __future__ import annotations

from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos

_ROSOUT_LIFESPAN_S = 10


def publisher_profile(topic: str, qos: Qos) -> QoSProfile:
    """For publishing `topic`: reliable, as REP-2003 asks of drivers, so that subscribers of either kind get it."""
    if topic == topics.ROSOUT.name:  # what rcl's own publisher has: whoever looks later sees the last lines too
        return _profile(qos.depth, reliable=True, latched=True, lifespan=Duration(seconds=_ROSOUT_LIFESPAN_S))
    return _profile(qos.depth, reliable=qos.reliable, latched=qos.latched)


def subscription_profile(topic: str, qos: Qos, publishers: list[Any]) -> QoSProfile:
    """For receiving `topic` from all of its `publishers` (rclpy's TopicEndpointInfo) that are known already.

    A subscription that asks for more than a publisher offers gets nothing from it. So it asks for no more than
    those who are there offer, and otherwise for what the table of topics says.
    """
    reliable = qos.reliable and topic != topics.CLOCK.name  # players publish the time as best effort
    latched = qos.latched or topics.default_qos(topic).latched
    if publishers:
        offered = [end.qos_profile for end in publishers]
        reliable = reliable and all(one.reliability == ReliabilityPolicy.RELIABLE for one in offered)
        latched = all(is_latched(one) for one in offered)
    return _profile(qos.depth, reliable=reliable, latched=latched)


def is_latched(profile: QoSProfile) -> bool:
    """Whether whoever comes later gets the last message too."""
    return bool(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def _profile(depth: int, *, reliable: bool, latched: bool, **more: Any) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(1, depth),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        **more,
    )
