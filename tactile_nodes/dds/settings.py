"""Where a participant listens, and whom it looks for: ROS 2's discovery range as Cyclone DDS is told it.

Source: ROS 2 documentation, "Improved Dynamic Discovery" (Iron and later), and what rmw_cyclonedds makes of it.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from tactile_nodes.errors import ConfigurationError

LOCALHOST, SUBNET = 'LOCALHOST', 'SUBNET'
RANGE_VARIABLE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_MOST_PARTICIPANTS = 32  # of one host and domain; rmw_cyclonedds looks for no more


@dataclass(frozen=True)
class Discovery:
    """LOCALHOST: this machine only. SUBNET: whoever answers on the network. `peers` are asked besides."""

    range: str = LOCALHOST
    peers: tuple[str, ...] = ()

    @classmethod
    def chosen(cls, wish: str, peers: Sequence[str], environment: Mapping[str, str] | None = None) -> Discovery:
        """`wish` or else what ROS 2's variable says, or else this machine only: nobody listens on a network unasked.

        Raises:
            ConfigurationError: a range that there is not, or peers beyond a range of this machine.
        """
        said = os.environ if environment is None else environment
        found = (wish or said.get(RANGE_VARIABLE, '') or LOCALHOST).upper()
        if found not in {LOCALHOST, SUBNET}:
            raise ConfigurationError(f'the discovery range {found} is not known here; choose {LOCALHOST} or {SUBNET}')
        if peers and found == LOCALHOST:
            raise ConfigurationError(f'peers on other machines need discovery_range:={SUBNET}')
        return cls(found, tuple(peers))

    @property
    def is_local(self) -> bool:
        return self.range == LOCALHOST

    def config(self) -> str | None:
        """Cyclone's configuration; None leaves it to CYCLONEDDS_URI and Cyclone's own choice of a network.

        For this machine it is what rmw_cyclonedds has for LOCALHOST. It names no interface: a side that speaks
        from 127.0.0.1 alone is not found by one that was there before and speaks from the machine's own address.
        `confining` sees to it that nothing but this machine is reached.

        Raises:
            ConfigurationError: a peer's name leads nowhere.
        """
        if not self.is_local and not self.peers:
            return None
        addresses = ('localhost', *map(_address, self.peers))
        peers = ''.join(f'<Peer address={quoteattr(address)}/>' for address in addresses)
        return (
            '<CycloneDDS><Domain>'
            f'<General><AllowMulticast>{"false" if self.is_local else "default"}</AllowMulticast></General><Discovery>'
            '<ParticipantIndex>auto</ParticipantIndex>'
            f'<MaxAutoParticipantIndex>{_MOST_PARTICIPANTS}</MaxAutoParticipantIndex><Peers>{peers}</Peers></Discovery>'
            '</Domain></CycloneDDS>'
        )


def _address(peer: str) -> str:
    try:
        return str(socket.getaddrinfo(peer, None, socket.AF_INET)[0][4][0])
    except OSError as error:  # Cyclone would abort the process
        raise ConfigurationError(f'the peer {peer!r} leads nowhere ({error}); give a name or an address') from error
