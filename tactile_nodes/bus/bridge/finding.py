"""Bridges that find each other by multicast, as ROS 2's participants do, where that was asked for.

Zenoh's scouting tells who listens where. The newer of two connects to the older, so that a host that comes disturbs
nobody; and only to one that has proven to hold a key that is allowed, since anybody on a network may answer.
"""

from __future__ import annotations

import ipaddress
import secrets
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.bridge.link import Address, Security, configured, open_session
from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.errors import BusError, ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import zenoh

GROUP = '224.0.0.224'
"""Where they send to, at the UDP port of the number that they listen at: other ports, other groups."""

ANYWHERE = '0.0.0.0', '::'  # noqa: S104
PATIENCE_S = 3.0
"""For so long the older one, whom we may have been connected to before a restart, is given to come back by itself."""

AT_MOST, AT_A_TIME = 64, 4
"""Anybody can say that somebody listens somewhere: so many are remembered, and tried at a time, a second each."""

AGAIN_WITHIN = {'listen/timeout_ms': 2000}
"""In which a port that this program has just left can be listened at again."""

AT_ONCE = {'connect/timeout_ms': 1000, 'connect/exit_on_failure': True}


@dataclass(frozen=True)
class Group:
    """What is looked for: those that `listen` at the same port of the same networks.

    `identity` orders them by their start (hexadecimal, as Zenoh has it).
    """

    listen: Address
    identity: str = field(default_factory=lambda: f'{SystemClock().now_ns():016x}{secrets.token_hex(4)}')

    def settings(self) -> dict[str, Any]:
        """What a session needs in order to be found, by its place in Zenoh's configuration.

        Raises:
            ConfigurationError: the address is none of this machine.
        """
        multicast = {
            'enabled': True, 'listen': True, 'autoconnect': [], 'address': f'{GROUP}:{self.listen.port}',
            'interface': self._interfaces(),
        }  # fmt: skip
        return {'id': self.identity, 'scouting/multicast': multicast}

    def _interfaces(self) -> str:
        if self._host in ANYWHERE:
            return 'auto'
        named = {name for name, end in _own_ends() if str(end.ip) == self._host}
        if not named:
            raise ConfigurationError(
                f'{self._host} is not an address of this machine; to be found on all networks, listen on 0.0.0.0'
            )
        return ','.join(sorted(named))

    @property
    def _host(self) -> str:
        return self.listen.host.strip('[]')


class Finder:
    """Looks for the others of a group, until it is closed."""

    def __init__(self, group: Group, security: Security, plain_tcp: str) -> None:
        import zenoh

        self._group, self._security, self._plain_tcp = group, security, plain_tcp
        self._found: dict[str, tuple[float, tuple[Address, ...]]] = {}
        self._trying: threading.Thread | None = None
        self._answering: list[Address] = []
        self._scout = zenoh.scout(self._hear, what='peer', config=configured(group.settings()))

    def close(self) -> None:
        self._scout.stop()

    @property
    def trying(self) -> bool:
        """Whether a thread tries an address at the moment."""
        return self._trying is not None and self._trying.is_alive()

    def missing(self, connected: Iterable[str]) -> list[Address]:
        """Where those are who are older, and not `connected` (their identities) though they are there for a while.

        Each is tried first, in a thread, since one that is silent takes a second; it is among those of a later call.
        """
        for identity in connected:
            self._found.pop(identity, None)
        if self.trying:
            return []
        answering, self._answering = self._answering, []
        late_s = monotonic_s() - PATIENCE_S
        due = [identity for identity, (since_s, _) in list(self._found.items()) if since_s < late_s]
        addresses = [address for identity in due[:AT_A_TIME] for address in self._found.pop(identity)[1]]
        if addresses:
            self._trying = threading.Thread(target=self._try, args=(addresses[:AT_A_TIME],), daemon=True)
            self._trying.start()
        return answering

    def _hear(self, hello: zenoh.Hello) -> None:
        """What anybody sends; called by a thread of Zenoh's."""
        identity = str(hello.zid)
        older = int(identity, 16) < int(self._group.identity, 16)
        if older and identity not in self._found and len(self._found) < AT_MOST:
            self._found[identity] = monotonic_s(), tuple(near(map(str, hello.locators), _own_ends()))

    def _try(self, addresses: Sequence[Address]) -> None:
        self._answering = [address for address in addresses if self._answers(address)]

    def _answers(self, address: Address) -> bool:
        """Whether somebody there lets us in."""
        try:
            open_session(None, [address], self._security, self._plain_tcp, AT_ONCE).close()
        except BusError:
            return False
        return True


def near(locators: Iterable[str], own_ends: Sequence[tuple[str, Any]]) -> Iterator[Address]:
    """Of what somebody says to listen at, that which lies in one of our networks and is not ours."""
    own, networks = {end.ip for _, end in own_ends}, [end.network for _, end in own_ends]
    for locator in locators:
        try:
            address = Address.parse(locator.partition('/')[2].partition('?')[0])
            ip = ipaddress.ip_address(address.host.strip('[]'))
        except (ConfigurationError, ValueError):  # a name, a path, or an address of a link
            continue
        if ip not in own and any(ip in network for network in networks):
            yield address


def _own_ends() -> list[tuple[str, Any]]:
    """Names of the network interfaces, and the addresses there with their networks."""
    import psutil

    ends = []
    for name, addresses in psutil.net_if_addrs().items():
        for each in addresses:
            try:
                ends.append((name, ipaddress.ip_interface(f'{each.address}/{each.netmask}')))
            except ValueError:  # a link's hardware address, or an IPv6 one, whose mask is written out
                continue
    return ends
