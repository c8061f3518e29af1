"""What DDS does between participants: it matches ends and carries bytes, in this process."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, compatible

LOCK = threading.RLock()
NODES: list[Any] = []
"""All living nodes of all contexts."""


def neighbours(node: Any) -> list[Any]:
    """The nodes of the same domain, itself included."""
    with LOCK:
        return [other for other in NODES if other.context.domain_id == node.context.domain_id]


def matched(publisher: Any) -> list[Any]:
    """The subscriptions that hear `publisher`."""
    return [end for node in neighbours(publisher.node) for end in node.subscription_ends if _hears(publisher, end)]


def carry(publisher: Any, data: bytes) -> None:
    """Give `data` to all who hear it, and keep it for those who come later if it is latched."""
    with LOCK:
        if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            publisher.kept = keep(publisher.qos_profile, [*publisher.kept, data])
        for subscription in matched(publisher):
            subscription.arrive(data)


def welcome(subscription: Any) -> None:
    """Give a new subscription what latched publishers keep for it."""
    with LOCK:
        if subscription.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return
        for node in neighbours(subscription.node):
            for publisher in node.publisher_ends:
                if _hears(publisher, subscription):
                    for data in publisher.kept:
                        subscription.arrive(data)


def keep(profile: Any, queue: list[Any]) -> list[Any]:
    """What of a queue a history holds."""
    return queue[-profile.depth :] if profile.history == HistoryPolicy.KEEP_LAST else queue


def servers(node: Any, name: str, srv_type: Any) -> list[Any]:
    """The services of this name and type."""
    found = [end for other in neighbours(node) for end in other.service_ends if end.srv_name == name]
    return [end for end in found if end.srv_type.__msgtype__ == srv_type.__msgtype__]


def _hears(publisher: Any, subscription: Any) -> bool:
    return (
        publisher.topic == subscription.topic
        and publisher.msg_type.__msgtype__ == subscription.msg_type.__msgtype__
        and compatible(publisher.qos_profile, subscription.qos_profile)
    )
