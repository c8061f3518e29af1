"""Where a participant listens and which peers it looks for: ROS 2's discovery range in Cyclone DDS's terms.

Source: ROS 2 documentation, "Improved Dynamic Discovery" (Iron and later), and its implementation in rmw_cyclonedds.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import psutil

from tactile_nodes.errors import ConfigurationError

LOCALHOST, SUBNET = 'LOCALHOST', 'SUBNET'
RANGE_VARIABLE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOOPBACK = 'lo'
_MOST_PARTICIPANTS = 32  # of one host and domain; rmw_cyclonedds looks for no more
_ASK_FOR, _ASK_EVERY = 'inf', '5s'


@dataclass(frozen=True)
class Discovery:
    """LOCALHOST: this machine only. SUBNET: all participants on the network. `peers` are contacted in addition."""

    range: str = LOCALHOST
    peers: tuple[str, ...] = ()

    @classmethod
    def chosen(cls, wish: str, peers: Sequence[str], environment: Mapping[str, str] | None = None) -> Discovery:
        """`wish`, else the value of ROS 2's variable, else this machine only: listening on a network must be requested.

        Raises:
            ConfigurationError: an unknown range, or peers together with the range of this machine.
        """
        variables = os.environ if environment is None else environment
        found = (wish or variables.get(RANGE_VARIABLE, '') or LOCALHOST).upper()
        if found not in {LOCALHOST, SUBNET}:
            raise ConfigurationError(f'{RANGE_VARIABLE} is {found}; choose LOCALHOST or SUBNET (dds_range:=)')
        if peers and found == LOCALHOST:
            raise ConfigurationError(f'peers on other machines need discovery_range:={SUBNET}')
        return cls(found, tuple(peers))

    @property
    def is_local(self) -> bool:
        return self.range == LOCALHOST

    def config(self) -> str | None:
        """Cyclone's configuration; None leaves it to CYCLONEDDS_URI and Cyclone's own choice of a network.

        For this machine it is what rmw_cyclonedds uses for LOCALHOST, with the loopback interface beside the one that
        Cyclone chooses. Announcements to 127.0.0.1 arrive by loopback, and Cyclone 11 drops packets from an interface
        that is not configured. A participant that uses 127.0.0.1 alone is not found by one that uses the machine's own
        address. `confining` ensures that only this machine is reached.

        It keeps contacting its peers: Cyclone by default gives up after 30 s, and a robot may be switched on later.

        Raises:
            ConfigurationError: a peer's name cannot be resolved.
        """
        if not self.is_local and not self.peers:
            return None
        general = f'<AllowMulticast>false</AllowMulticast>{_interfaces()}' if self.is_local else ''
        peers = ''.join(f'<Peer address={quoteattr(peer)}/>' for peer in ('localhost', *map(_address, self.peers)))
        return (
            f'<CycloneDDS><Domain><General>{general}</General><Discovery><ParticipantIndex>auto</ParticipantIndex>'
            f'<MaxAutoParticipantIndex>{_MOST_PARTICIPANTS}</MaxAutoParticipantIndex><Peers>{peers}</Peers>'
            f'<InitialLocatorPruneDelay>{_ASK_FOR}</InitialLocatorPruneDelay><SPDPInterval>{_ASK_EVERY}</SPDPInterval>'
            '</Discovery></Domain></CycloneDDS>'
        )


def _interfaces() -> str:
    """The interface that Cyclone chooses, and loopback if that is another one: Cyclone accepts none twice.

    Loopback comes second, because Cyclone would prefer it, and then a Cyclone 11 without it receives nothing from us.
    """
    if not _has_network():
        return ''
    return (
        '<Interfaces><NetworkInterface autodetermine="true"/>'
        f'<NetworkInterface name="{LOOPBACK}" multicast="false" priority="-1"/></Interfaces>'
    )


def _has_network() -> bool:
    """Whether an interface besides loopback is up and has an address: Cyclone then prefers it."""
    up = {name for name, state in psutil.net_if_stats().items() if 'up' in state.flags.split(',')} - {LOOPBACK}
    addresses = psutil.net_if_addrs()
    return any(entry.family == socket.AF_INET for name in up for entry in addresses.get(name, []))


def _address(peer: str) -> str:
    try:
        return str(socket.getaddrinfo(peer, None, socket.AF_INET)[0][4][0])
    except OSError as error:  # Cyclone would abort the process
        raise ConfigurationError(
            f'the peer {peer!r} cannot be resolved ({error}); use a host name or an address'
        ) from error
