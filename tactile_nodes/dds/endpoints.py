"""Readers and writers that pass CDR bytes unchanged.

Cyclone's Python package encodes messages itself, slowly. Its private functions (`_clayer`) take and return bytes.
Because they are private, setup.py pins the version, and tests check the functions used here.
"""

from __future__ import annotations

from typing import Any

from cyclonedds import _clayer
from cyclonedds.core import DDSException, InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from tactile_nodes.bus.protocol import Qos as BusQos
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.dds.names import endpoint_data
from tactile_nodes.errors import BusError

_UNLIMITED = -1
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_AT_ONCE = 64
_CDR_LITTLE, _CDR_BIG = b'\0\1', b'\0\0'


def writer_qos(type_name: str, qos: BusQos, lifespan_s: float | None = None) -> Qos:
    """Keep last, as ROS 2 offers it; latched is transient local. A write never waits for a reader."""
    history = Policy.History.KeepLast(qos.depth)
    policies = [
        _reliability(qos),
        history,
        _durability(qos),
        Policy.DurabilityService(0, history, _UNLIMITED, _UNLIMITED, _UNLIMITED),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(endpoint_data(type_name)),
    ]
    if lifespan_s is not None:
        policies.append(Policy.Lifespan(round(lifespan_s * NS_PER_S)))
    return Qos(*policies)


def reader_qos(type_name: str, qos: BusQos) -> Qos:
    """Keep last, from other participants; a reader that is neither reliable nor latched matches every writer."""
    return Qos(
        _reliability(qos),
        Policy.IgnoreLocal.Participant,
        Policy.History.KeepLast(qos.depth),
        _durability(qos),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(endpoint_data(type_name)),
    )


class CdrWriter:
    """Writes encoded messages; `gid` identifies it among ROS 2's endpoints."""

    def __init__(self, writer: DataWriter[Any]) -> None:
        self.gid = writer.guid.bytes
        self.dropped = 0
        self._writer = writer

    @property
    def readers(self) -> int:
        """The number of readers that would get a message written now."""
        return int(self._writer.get_publication_matched_status().current_count)

    def write(self, data: bytes | memoryview) -> None:
        """Send one message. If a reliable reader is too far behind, the message is dropped and counted.

        Raises:
            BusError: it cannot be sent.
        """
        outcome = _clayer.ddspy_write(self._writer._ref, bytes(data) + bytes(-len(data) % 4))
        if outcome == DDSException.DDS_RETCODE_TIMEOUT:
            self.dropped += 1
        elif outcome < 0:
            raise BusError(f'cannot send {self._writer.topic.name} over DDS: {DDSException(outcome)}')


class CdrReader:
    """Returns messages as the received bytes, each with the handle of its writer."""

    def __init__(self, reader: DataReader[Any]) -> None:
        self.gid = reader.guid.bytes
        self.malformed = 0
        self._reader = reader

    @property
    def writers(self) -> set[int]:
        """The handles of the writers that are there now."""
        return {handle % 2**64 for handle in self._reader.get_matched_publications()}  # given as signed numbers

    def take(self) -> list[tuple[int, bytes]]:
        """The messages received since the last call, a few dozen at most; data that are not plain CDR are only counted.

        Raises:
            BusError: nothing can be taken.
        """
        found = _clayer.ddspy_take(self._reader._ref, _ANY, _AT_ONCE)
        if isinstance(found, int):
            raise BusError(f'cannot read {self._reader.topic.name} from DDS: {DDSException(found)}')
        valid = [(info.publication_handle, data) for data, info in found if info.valid_data]
        plain = [(writer, _without_padding(data)) for writer, data in valid if data[:2] in {_CDR_LITTLE, _CDR_BIG}]
        self.malformed += len(valid) - len(plain)
        return plain


def _durability(qos: BusQos) -> Any:
    return Policy.Durability.TransientLocal if qos.latched else Policy.Durability.Volatile


def _reliability(qos: BusQos) -> Any:
    return Policy.Reliability.Reliable(max_blocking_time=0) if qos.reliable else Policy.Reliability.BestEffort


def _without_padding(data: bytes) -> bytes:
    """The last two bits of the header give the number of padding bytes at the end (XTypes 1.3, 7.6.3.1.2)."""
    padding = data[3] & 3
    return data[: len(data) - padding] if padding else data
