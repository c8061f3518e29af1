"""Opens a participant if the extra that it needs is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_nodes.dds.settings import Discovery
from tactile_nodes.errors import from_extra

if TYPE_CHECKING:
    from tactile_nodes.dds.participant import Participant


def open_participant(domain_id: int, discovery: Discovery) -> Participant:
    """Join a DDS domain.

    Raises:
        BusError: it cannot be joined.
        ConfigurationError: Cyclone DDS is not installed.
    """
    with from_extra('dds', 'speaking DDS'):
        from tactile_nodes.dds.participant import Participant
    return Participant(domain_id, discovery)
