"""Opens a participant, where the extra that it needs is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_nodes.dds.settings import Discovery
from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.dds.participant import Participant


def open_participant(domain_id: int, discovery: Discovery) -> Participant:
    """Join a DDS domain.

    Raises:
        BusError: it cannot be joined.
        ConfigurationError: Cyclone DDS is not installed.
    """
    try:
        from tactile_nodes.dds.participant import Participant
    except ImportError as error:
        raise ConfigurationError(
            f"DDS needs Cyclone DDS ({error}); install it with: pip install 'tactile_nodes[dds]'"
        ) from error
    return Participant(domain_id, discovery)
