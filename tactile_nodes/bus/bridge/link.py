"""One Zenoh session over one TCP port: encrypted, and open to those whose keys are allowed.

Zenoh's own finding of others (multicast, gossip) is off, and so are its shared memory and its administration: nothing
is reached but the address that was given, and nothing listens but the one that was asked for. Being found is asked for
by further settings (`tactile_nodes.bus.bridge.finding`).
"""

from __future__ import annotations

import base64
import ipaddress
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.bridge.keys import KeyPair
from tactile_nodes.errors import AddressInUseError, BusError, ConfigurationError, from_extra

if TYPE_CHECKING:
    import zenoh

PLAIN_TCP = 'anyone on this network may read and send'
_ADDRESS = re.compile(r'(tcp://)?(?P<host>\[[0-9a-fA-F:.]+\]|[\w.*-]+):(?P<port>\d{1,5})')
GONE_AFTER_MS = 3000
_RETRY = {'period_init_ms': 100, 'period_max_ms': 2000, 'period_increase_factor': 2}
LONGEST_BYTES = 128 << 20
_CONNECTIONS = '0-5', '6-7'
"""The priorities of two TCP connections to the one port: pictures, of low priority, do not stand before forces."""
_QUEUE_BYTES = 256 << 10  # in the kernel, for each connection; it would hold seconds of a slow one


@dataclass(frozen=True)
class Security:
    """Whom to trust: this machine's `own` keys and the others' public ones; None where nothing is encrypted."""

    own: KeyPair | None = None
    peers: tuple[bytes, ...] = ()


OPEN = Security()


@dataclass(frozen=True)
class Address:
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Address:
        """'192.168.0.7:7460', '[::1]:7460', '0.0.0.0:7460'.

        Raises:
            ConfigurationError: not of that form.
        """
        match = _ADDRESS.fullmatch(text)
        if not match or not 0 < int(match['port']) < 65536:
            raise ConfigurationError(f'{text!r} is not an address; use host:port, e.g. 192.168.0.7:7460')
        return cls('0.0.0.0' if match['host'] == '*' else match['host'], int(match['port']))  # noqa: S104

    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return self.host == 'localhost' or ipaddress.ip_address(self.host.strip('[]')).is_loopback
        except ValueError:  # a name
            return False

    def __str__(self) -> str:
        return f'{self.host}:{self.port}'


def open_session(
    listen: Address | None,
    connect: Sequence[Address] = (),
    security: Security = OPEN,
    plain_tcp: str = '',
    further: Mapping[str, Any] = MappingProxyType({}),
) -> zenoh.Session:
    """A session that listens for any number of others, that connects to some and comes back by itself, or both.

    `further` settings are those of Zenoh, by their place in its configuration.

    Raises:
        ConfigurationError: unencrypted, and reachable by others, without the words that allow it; or no Zenoh.
        AddressInUseError: somebody else listens there.
        BusError: the address cannot be used.
    """
    ends = [*([listen] if listen else []), *connect]
    far = [address for address in ends if not address.is_loopback()]
    if security.own is None and far and plain_tcp != PLAIN_TCP:
        raise ConfigurationError(
            f'a connection over {far[0]} without keys could be read and used by anyone on the network; make keys '
            f'with: tactile keys create NAME, or set plain_tcp to {PLAIN_TCP!r}'
        )
    with from_extra('bridge', 'a bridge'):
        import zenoh
    try:
        return zenoh.open(configured({**_settings(listen, connect, security), **further}))
    except zenoh.ZError as error:
        raise _translated(str(error), ends[0]) from error


def configured(settings: Mapping[str, Any]) -> zenoh.Config:
    """Zenoh's configuration with settings by their place in it, and its defaults beside them."""
    import zenoh

    config = zenoh.Config()
    for place, value in settings.items():
        config.insert_json5(place, json.dumps(value))
    return config


def _settings(listen: Address | None, connect: Sequence[Address], security: Security) -> dict[str, Any]:
    """What differs from Zenoh's defaults, by its place in the configuration (Zenoh's DEFAULT_CONFIG.json5)."""
    protocol = 'tls' if security.own else 'tcp'
    found: dict[str, Any] = {
        'mode': 'peer',
        'listen/endpoints': [f'{protocol}/{listen}'] if listen else [],
        'connect/endpoints': [
            f'{protocol}/{address}?prio={priorities}' for address in connect for priorities in _CONNECTIONS
        ],
        'transport/unicast/open_timeout': GONE_AFTER_MS,
        'transport/unicast/max_links': len(_CONNECTIONS),
        f'transport/link/{protocol}': {'so_sndbuf': _QUEUE_BYTES},
        'connect/exit_on_failure': False,
        'connect/timeout_ms': -1,
        'connect/retry': _RETRY,
        'scouting/multicast/enabled': False,
        'scouting/gossip/enabled': False,
        'open/return_conditions/connect_scouted': False,
        'transport/shared_memory/enabled': False,
        'transport/link/tx/lease': GONE_AFTER_MS,
        'transport/link/rx/max_message_size': LONGEST_BYTES,
    }
    if security.own is not None:
        own, secret = (base64.b64encode(text).decode() for text in (security.own.public, security.own.secret))
        found['transport/link/tls'] |= {
            'root_ca_certificate_base64': base64.b64encode(b''.join(security.peers)).decode(),
            'listen_certificate_base64': own,
            'listen_private_key_base64': secret,
            'connect_certificate_base64': own,
            'connect_private_key_base64': secret,
            'enable_mtls': True,
            'verify_name_on_connect': False,  # the key is known; the name under which it is reached may be any
        }
    return found


def _translated(text: str, address: Address) -> BusError:
    if 'os error 98' in text:  # EADDRINUSE
        return AddressInUseError(
            f'port {address.port} is in use on {address.host}; stop the program that listens there (ss -ltnp sport = '
            f':{address.port} shows it), or choose another port'
        )
    reason = text.partition('[')[2].partition(' at /')[0] or text
    return BusError(f'cannot use {address}: {reason}; is it an address of this machine?')
