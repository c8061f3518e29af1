"""Two hosts on a cable: network namespaces on a virtual Ethernet, with limited rate and packet loss by the kernel."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from tactile_nodes.errors import ConfigurationError

ADDRESSES = '10.213.8.1', '10.213.8.2'


@dataclass(frozen=True)
class Cable:
    """Properties of the cable in each direction (``man tc-tbf``, ``man iptables-extensions``)."""

    mbit: float
    loss_percent: float = 0.0


class Network:
    """The two hosts; `hosts` are the names of their namespaces."""

    def __init__(self, hosts: tuple[str, str]) -> None:
        self.hosts = hosts

    def lay(self, cable: Cable) -> None:
        """Set the properties of the cable; the queue on each side holds up to 50 ms of data."""
        burst = max(4, round(cable.mbit / 8))  # kB in a millisecond
        shape = ['tbf', 'rate', f'{cable.mbit}mbit', 'burst', f'{burst}kb', 'latency', '50ms']
        share = str(cable.loss_percent / 100.0)
        drop = ['INPUT', '-m', 'statistic', '--mode', 'random', '--probability', share, '-j', 'DROP']
        for host in self.hosts:
            _within(host, 'tc', 'qdisc', 'replace', 'dev', host, 'root', *shape)
            _within(host, 'iptables', '-F', 'INPUT')
            if cable.loss_percent:
                _within(host, 'iptables', '-A', *drop)

    def plug(self, *, on: bool) -> None:
        """Pull the cable, or put it back."""
        _run('ip', '-n', self.hosts[0], 'link', 'set', self.hosts[0], 'up' if on else 'down')


@contextmanager
def network() -> Iterator[Network]:
    """Make the network, and remove it at the end.

    Raises:
        ConfigurationError: the user lacks the permission, or the tools are missing (Debian: iproute2, iptables).
    """
    hosts = (f'tb{os.getpid()}a', f'tb{os.getpid()}b')
    try:
        for host in hosts:
            _run('ip', 'netns', 'add', host)
            _run('ip', '-n', host, 'link', 'set', 'lo', 'up')
        _run('ip', 'link', 'add', hosts[0], 'type', 'veth', 'peer', 'name', hosts[1])
        for host, address in zip(hosts, ADDRESSES, strict=True):
            _run('ip', 'link', 'set', host, 'netns', host)
            _run('ip', '-n', host, 'address', 'add', f'{address}/24', 'dev', host)
            # Packets of real size; otherwise the kernel passes, and loses, 64 kB at once.
            _run('ip', '-n', host, 'link', 'set', host, 'gso_max_segs', '1', 'up')
        yield Network(hosts)
    finally:
        for host in hosts:
            subprocess.run(['ip', 'netns', 'delete', host], check=False, capture_output=True)


def _within(host: str, *words: str) -> None:
    _run('ip', 'netns', 'exec', host, *words)


def _run(*words: str) -> None:
    try:
        subprocess.run(words, check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f'{words[0]} is missing; install it with: apt-get install iproute2 iptables'
        ) from error
    except subprocess.CalledProcessError as error:
        raise ConfigurationError(
            f'no network of two hosts can be made here ({error.stderr.strip()}); run this as root'
        ) from error
