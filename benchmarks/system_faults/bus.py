"""Damages the run folder in several ways, because the bus has no broker to kill; and sends invalid messages."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import zmq

from benchmarks.system_faults.sensor import Sensor
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Endpoint, Participant, Qos
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.discovery import Meeting, domain_from_environment
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.records import Outlet, Record
from tactile_nodes.bus.zeromq.sockets import Longest, open_socket
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.paths import run_directory

WATCH_S, PATIENCE_S = 4.0, 10.0
FORGED = (
    topics.IMAGE, topics.CAMERA_INFO, topics.REFERENCE_IMAGE, topics.FLOW_FEATURES, topics.FORCE_DISTRIBUTION,
    topics.WRENCH, topics.TRUE_FORCE, topics.MODEL_IN_USE, topics.CALIBRATION_IMAGE, topics.CALIBRATION_STATE,
    topics.DIAGNOSTICS, topics.ROSOUT,
)  # fmt: skip


def _remove(folder: Path, ending: str) -> None:
    for file in folder.glob(f'*{ending}'):
        file.unlink(missing_ok=True)


def _scribble(folder: Path) -> None:
    for file in folder.glob('*.json'):
        file.write_bytes(random.Random(1).randbytes(300))  # noqa: S311 - garbage


SPOILT: dict[str, Callable[[Path], None]] = {
    'records removed (`*.json`)': lambda folder: _remove(folder, '.json'),
    'records overwritten with random bytes': _scribble,
    'locks removed (`*.lock`)': lambda folder: _remove(folder, '.lock'),
    'sockets removed (`*.sock`)': lambda folder: _remove(folder, '.sock'),
    'the whole folder removed': lambda folder: shutil.rmtree(folder, ignore_errors=True),
}


@dataclass(frozen=True)
class Spoilt:
    """A fault of the run folder during sensing.

    Attributes:
        forces: forces that an existing subscriber received in the 4 s after it; `before`: in the 4 s before it.
        newcomer_s: time until a new subscriber gets forces; NaN: not within 10 s.
        died: processes of the launch that ended.
    """

    what: str
    before: int
    forces: int
    newcomer_s: float
    died: tuple[str, ...]
    load: float


def spoil(running: Sensor, what: str, watch_s: float = WATCH_S) -> Spoilt:
    """Apply one fault, and measure its effect."""
    folder = run_directory() / f'd{domain_from_environment()}'
    alive = _alive(running)
    before = len(running.watch(running.clock.now_ns() + round(watch_s * NS_PER_S)))
    SPOILT[what](folder)
    newcomer_s = _newcomer(running)
    forces = len(running.watch(running.clock.now_ns() + round(watch_s * NS_PER_S)))
    died = tuple(sorted(alive - _alive(running)))
    return Spoilt(what, before, forces, newcomer_s, died, round(os.getloadavg()[0], 1))


def _newcomer(running: Sensor) -> float:
    start_ns, kind = running.clock.now_ns(), topics.FORCE_DISTRIBUTION
    bus = ZmqBus()
    try:
        received = bus.subscribe(f'/{kind.name}', kind.type_name, Qos('latest', 1)).get(PATIENCE_S)
        return float('nan') if received is None else (running.clock.now_ns() - start_ns) / NS_PER_S
    finally:
        bus.close()


def garbage(running: Sensor, frames: int, watch_s: float = WATCH_S, seed: int = 1) -> dict[str, Any]:
    """Send random frames to every socket of a running sensor, and random messages of every topic; counts effects."""
    chance = random.Random(seed)  # noqa: S311 - garbage
    alive = _alive(running)
    sockets = _to_sockets(frames, chance)
    running.watch(running.clock.now_ns() + NS_PER_S // 2)
    messages = _to_topics(frames, chance)
    after = running.watch(running.clock.now_ns() + round(watch_s * NS_PER_S))
    warnings = [line for _, line in list(running.launch.lines) if 'dropped a message' in line]
    bugs = [line for _, line in list(running.launch.lines) if 'Traceback' in line or 'a bug in the thread' in line]
    return {
        'sockets': sockets, 'frames': frames * sockets, 'topics': len(FORGED), 'messages': messages,
        'died': sorted(alive - _alive(running)), 'forces_after': len(after), 'told': warnings, 'bugs': bugs,
    }  # fmt: skip


def _to_sockets(frames: int, chance: random.Random) -> int:
    """Send random frames to each socket file, as a subscriber or as a caller of a service."""
    folder = run_directory() / f'd{domain_from_environment()}'
    found = sorted(folder.glob('*.sock'))
    with zmq.Context() as context:
        for file in found:
            kind = zmq.DEALER if file.name.endswith('.0.sock') else zmq.XSUB
            with open_socket(context, kind, Longest.PICTURE) as socket:
                socket.set(zmq.LINGER, 200)
                socket.connect(f'ipc://{file}')
                for _ in range(frames):
                    parts = [chance.randbytes(chance.randrange(60)) for _ in range(chance.randrange(1, 6))]
                    socket.send(parts[0]) if socket.type == zmq.XSUB else socket.send_multipart(parts)
    return len(found)


def _to_topics(frames: int, chance: random.Random) -> int:
    """Send random messages from a forged participant that announces itself as a publisher of every topic."""
    meeting = Meeting('f0f0f0f0', domain_from_environment())
    sent = 0
    with zmq.Context() as context:
        sockets, outlets, ends = [], [], []
        for number, topic in enumerate(FORGED, start=1):
            name = topic.name if topic.name.startswith('/') else f'/{topic.name}'
            sockets.append(open_socket(context, zmq.XPUB, Longest.WORD))
            sockets[-1].set(zmq.LINGER, 200)
            sockets[-1].bind(address := meeting.socket_address(number))
            outlets.append(Outlet(f'f0f0f0f0.{number}', name, topic.type_name, address))
            ends.append(Endpoint(name, topic.type_name, '/forger'))
        participant = Participant('f0f0f0f0', os.getpid(), 'here', ('/forger',), tuple(ends))
        meeting.announce(Record(participant, tuple(outlets), meeting.socket_address(0)))
        for socket, outlet in zip(sockets, outlets, strict=True):
            if socket.poll(2000):  # there is a subscriber
                key = wire.type_key(outlet.type_name)
                for number in range(frames):
                    head = wire.pack_header(outlet.gid.encode(), key, number + 1, 1)
                    socket.send_multipart([head, chance.randbytes(chance.randrange(400))])
                sent += frames
            socket.close()
    meeting.leave()
    return sent


def _alive(running: Sensor) -> set[str]:
    return {name for name, pid in running.launch.pids.items() if psutil.pid_exists(pid)}
