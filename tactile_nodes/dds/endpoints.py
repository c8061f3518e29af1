"""Readers and writers that pass CDR bytes as they are.

Cyclone's Python package encodes messages itself, slowly. Below its public classes are functions that take and give
bytes (`_clayer`); they are private, so setup.py pins the version and the tests hold them to what is needed here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cyclonedds import _clayer
from cyclonedds.core import DDSException, InstanceState, Listener, Policy, Qos, SampleState, ViewState
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
        Policy.Durability.TransientLocal if qos.latched else Policy.Durability.Volatile,
        Policy.DurabilityService(0, history, _UNLIMITED, _UNLIMITED, _UNLIMITED),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(endpoint_data(type_name)),
    ]
    if lifespan_s is not None:
        policies.append(Policy.Lifespan(round(lifespan_s * NS_PER_S)))
    return Qos(*policies)


def reader_qos(type_name: str, qos: BusQos) -> Qos:
    """Keep last and volatile; what is not reliable every writer satisfies."""
    return Qos(
        _reliability(qos),
        Policy.History.KeepLast(qos.depth),
        Policy.Durability.Volatile,
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(endpoint_data(type_name)),
    )


class CdrWriter:
    """Writes messages that are encoded already; `gid` is its name among ROS 2's endpoints."""

    def __init__(self, writer: DataWriter[Any]) -> None:
        self.gid = writer.guid.bytes
        self.dropped = 0
        self._writer = writer

    @property
    def readers(self) -> int:
        """How many would get what is written now."""
        return int(self._writer.get_publication_matched_status().current_count)

    def write(self, data: bytes | memoryview) -> None:
        """Send one message; where a reader that wants all of them is too far behind it is dropped, and counted.

        Raises:
            BusError: it cannot be sent.
        """
        outcome = _clayer.ddspy_write(self._writer._ref, bytes(data) + bytes(-len(data) % 4))
        if outcome == DDSException.DDS_RETCODE_TIMEOUT:
            self.dropped += 1
        elif outcome < 0:
            raise BusError(f'cannot send {self._writer.topic.name} over DDS: {DDSException(outcome)}')


class CdrReader:
    """Gives messages as the bytes that came."""

    def __init__(self, reader: DataReader[Any]) -> None:
        self.gid = reader.guid.bytes
        self.malformed = 0
        self._reader = reader

    def take(self) -> list[bytes]:
        """What has come in since, at most a few dozen messages; what is no plain CDR is counted only.

        Raises:
            BusError: nothing can be taken.
        """
        found = _clayer.ddspy_take(self._reader._ref, _ANY, _AT_ONCE)
        if isinstance(found, int):
            raise BusError(f'cannot read {self._reader.topic.name} from DDS: {DDSException(found)}')
        valid = [data for data, info in found if info.valid_data]
        plain = [_without_padding(data) for data in valid if data[:2] in {_CDR_LITTLE, _CDR_BIG}]
        self.malformed += len(valid) - len(plain)
        return plain


def listener(on_data: Callable[[], None]) -> Listener:
    """What calls `on_data`, in a thread of Cyclone's, whenever something has come in."""
    return Listener(on_data_available=lambda _: on_data())


def _reliability(qos: BusQos) -> Any:
    return Policy.Reliability.Reliable(max_blocking_time=0) if qos.reliable else Policy.Reliability.BestEffort


def _without_padding(data: bytes) -> bytes:
    """The last two bits of the header say how many bytes only fill the last four (XTypes 1.3, 7.6.3.1.2)."""
    padding = data[3] & 3
    return data[: len(data) - padding] if padding else data
