"""One TCP connection to the bridges of other machines: encrypted, and open to those whose keys are allowed."""

from __future__ import annotations

import errno
import ipaddress
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zmq
from zmq.utils import z85

from tactile_nodes.bus.bridge.keys import KeyPair
from tactile_nodes.bus.zeromq.sockets import Longest, open_socket
from tactile_nodes.errors import AddressInUseError, BusError, ConfigurationError

PLAIN_TCP = 'anyone on this network may read and send'
_ADDRESS = re.compile(r'(tcp://)?(?P<host>\[[0-9a-fA-F:.]+\]|[\w.*-]+):(?P<port>\d{1,5})')
_QUEUE = 8  # messages; what does not fit waits in its own topic's queue, where the newest wins
_ZAP = 'inproc://zeromq.zap.01'


@dataclass(frozen=True)
class Security:
    """Whom to trust: this machine's `own` keys and the others' public ones; None where nothing is encrypted."""

    own: KeyPair | None = None
    peers: tuple[bytes, ...] = ()


@dataclass(frozen=True)
class Address:
    """A host and a TCP port."""

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
            raise ConfigurationError(f'{text!r} is no address; write host:port, say 192.168.0.7:7460')
        return cls(match['host'], int(match['port']))

    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return self.host == 'localhost' or ipaddress.ip_address(self.host.strip('[]')).is_loopback
        except ValueError:  # a name, or all interfaces
            return False

    def __str__(self) -> str:
        return f'{self.host}:{self.port}'


class Link:
    """A listening end, which any number of others join, or a connecting one, which comes back by itself.

    Raises:
        ConfigurationError: unencrypted, and reachable by others, without the words that allow it.
        AddressInUseError: somebody else listens there.
        BusError: the address cannot be used.
    """

    def __init__(self, address: Address, *, listens: bool, name: str, security: Security, plain_tcp: str = '') -> None:
        if security.own is None and not address.is_loopback() and plain_tcp != PLAIN_TCP:
            raise ConfigurationError(
                f'a connection over {address} without keys could be read and used by anyone on the network; make keys '
                f'with: tactile keys create NAME, or set plain_tcp to {PLAIN_TCP!r}'
            )
        self.refused = 0
        self._allowed = set(security.peers)
        self._context = zmq.Context()
        self._zap = open_socket(self._context, zmq.REP, Longest.CALL)
        self._zap.bind(_ZAP)
        self.socket = open_socket(self._context, zmq.ROUTER if listens else zmq.DEALER, Longest.PICTURE)
        self.listens = listens
        self._set_options(name, security, ipv6=':' in address.host)
        try:
            (self.socket.bind if listens else self.socket.connect)(f'tcp://{address}')
        except zmq.ZMQError as error:
            self.close()
            raise _translated(error, address) from error

    def watch_with(self, watch: Callable[[Any, Callable[[], None]], None], on_readable: Callable[[], None]) -> None:
        """Register the sockets with a loop, whose thread is the only one to use this link from then on."""
        watch(self.socket, on_readable)
        watch(self._zap, self._judge)

    def send(self, peer: bytes, frames: list[Any]) -> bool:
        """Send to `peer` (b'' for the one that we connect to); false when there is no room or no connection."""
        try:
            self.socket.send_multipart([peer, *frames] if self.listens else frames, zmq.NOBLOCK)
        except zmq.ZMQError:
            return False
        return True

    def receive(self) -> tuple[bytes, list[bytes]] | None:
        """Who said what; None when there is nothing more."""
        try:
            frames = self.socket.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return None
        return (frames[0], frames[1:]) if self.listens else (b'', frames)

    def close(self) -> None:
        """Disconnect."""
        self._context.destroy(linger=100)

    def _set_options(self, name: str, security: Security, *, ipv6: bool) -> None:
        options: dict[int, Any] = {
            zmq.SNDHWM: _QUEUE,
            zmq.RCVHWM: _QUEUE,
            zmq.LINGER: 100,
            zmq.HEARTBEAT_IVL: 1000,
            zmq.HEARTBEAT_TIMEOUT: 3000,
            zmq.RECONNECT_IVL: 100,
            zmq.RECONNECT_IVL_MAX: 2000,
            zmq.IPV6: int(ipv6),
        }
        if self.listens:
            options |= {zmq.ROUTER_MANDATORY: 1, zmq.ROUTER_HANDOVER: 1}
        else:
            options |= {zmq.ROUTING_ID: name.encode(), zmq.IMMEDIATE: 1}
        if security.own is not None:
            options |= {zmq.CURVE_PUBLICKEY: security.own.public, zmq.CURVE_SECRETKEY: security.own.secret}
            options |= {zmq.CURVE_SERVER: 1} if self.listens else {zmq.CURVE_SERVERKEY: security.peers[0]}
        for option, value in options.items():
            self.socket.set(option, value)

    def _judge(self) -> None:
        """Answer ZeroMQ's question (RFC 27) whether somebody may connect."""
        version, request, _, _, _, mechanism, *credentials = self._zap.recv_multipart()
        allowed = mechanism == b'NULL' or (mechanism == b'CURVE' and z85.encode(credentials[0]) in self._allowed)
        self.refused += not allowed
        self._zap.send_multipart([version, request, *((b'200', b'') if allowed else (b'400', b'unknown')), b'', b''])


def _translated(error: zmq.ZMQError, address: Address) -> BusError:
    if error.errno == errno.EADDRINUSE:
        return AddressInUseError(
            f'port {address.port} is taken on {address.host}; end the program that listens there (ss -ltnp sport = '
            f':{address.port} names it), or choose another port'
        )
    return BusError(f'cannot use {address}: {error.strerror}; is it an address of this machine?')
