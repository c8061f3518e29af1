"""Runs a real ``tactile launch collect rig:=emulated`` in a separate folder, and acts as its user."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.parameters import to_message
from tactile_nodes.bus.protocol import Bus, Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import ConfigurationError, ServiceError
from tactile_nodes.messages import services, types
from tactile_nodes.params import Value

RIG, ACKNOWLEDGE = '/emulated_rig', '/rig/acknowledge'
SAFE_MM, GEL_MM, ROOM_MM = -4.0, (-20.0, -20.0, -8.0), (40.0, 40.0, 12.0)
START_MM = (-12.0, -14.0, -2.0)
LIMITS = 'force_silence_ms: 200.0, camera_silence_ms: 1000.0'  # as in config/rigs/emulated.yaml
ROOM_BYTES = 20_000
TRIGGER_MM = 0.2  # deep, and on its way down
PLAN = 'kind: grid\ncolumns: {columns}\nrows: {rows}\npitch_mm: 5.0\ndepths_mm: [0.8]\n'
DEVICES = """\
/**/emulated_rig:
  ros__parameters:
    {{rdt_port: {rdt}, http_port: {http}, camera_port: {camera}, fps: 20.0, sensor: {sensor}, trace: {trace},
      sensor_port: {folder}/ft,
      world: {{room_mm: [{room}], start_mm: [{start}], gel_x_mm: {gel[0]}, gel_y_mm: {gel[1]}, gel_z_mm: {gel[2]}}},
      grbl: {{changes: [$130=40, $131=40, $132=12]}}}}
/**/camera:
  ros__parameters: {{source: 'http://127.0.0.1:{camera}/'}}
/**/rig:
  ros__parameters:
    cnc: {{kind: grbl, boot_s: 0.5, report_hz: 10.0, safe_z_mm: {safe}}}
    force_torque: {{source: '{source}', rate_hz: 1000.0, net_ft: {{rdt_port: {rdt}, http_port: {http}}}}}
    mounting: {{upside_down: true}}
    surface: {{gel_x_mm: {gel[0]}, gel_y_mm: {gel[1]}, top_mm: {top}, bottom_mm: {bottom}, corners: 3, repeats: 1,
      dwell_s: 0.05, beyond: 2, step_mm: 0.2, fine_step_mm: 0.1, feed_mm_min: 60.0}}
    limits: {{{limits}}}
    sync: {{pulses: 0}}
    anchor: {{every: {anchor}}}
"""
_STARTED = re.compile(r'\[(\w+)-\d+\]: process started with pid \[(\d+)\]')
_NODE = re.compile(r'^\[\w+-\d+\] (?:\[(\w+)\] \[\d+\.\d+\] \[\w+\]: )?(.*)')
_DULL = re.compile(r'^\[[-=#>]|^(subscribed|wrote|collection: \[|bag: recording|picture:|cnc: (Jog|Run|Idle)$)')


@dataclass(frozen=True)
class Bench:
    """Common settings of all launches for a fault.

    Attributes:
        folder: folder for this fault.
        sensor: force/torque sensor of the rig.
        size: columns and rows of the plan.
        limits: parameters of the rig's limits.
        anchor: presses between two anchors; 0: no anchors.
    """

    folder: Path
    sensor: str = 'netft'
    size: tuple[int, int] = (2, 2)
    limits: str = LIMITS
    anchor: int = 0

    @property
    def trace(self) -> Path:
        """The trace of the tip over all launches."""
        return self.folder / 'trace.jsonl'

    def write(self, start_mm: Sequence[float] = START_MM) -> list[str]:
        """Write plan and devices, with free ports; returns the arguments for the launch."""
        self.folder.mkdir(parents=True, exist_ok=True)
        plan, devices = self.folder / 'plan.yaml', self.folder / 'devices.yaml'
        plan.write_text(PLAN.format(columns=self.size[0], rows=self.size[1]), encoding='ascii')
        rdt, http, camera = free_ports()
        source = 'netft://127.0.0.1' if self.sensor == 'netft' else f'{self.sensor}:{self.folder}/ft'
        room, start = (', '.join(map(str, values)) for values in (ROOM_MM, start_mm))
        text = DEVICES.format(
            rdt=rdt, http=http, camera=camera, sensor=self.sensor, trace=self.trace, folder=self.folder, room=room,
            start=start, gel=GEL_MM, safe=SAFE_MM, source=source, top=GEL_MM[2] + 0.1, bottom=GEL_MM[2] - 1.5,
            limits=self.limits, anchor=self.anchor,
        )  # fmt: skip
        devices.write_text(text, encoding='ascii')
        return ['rig:=emulated', f'devices:={devices}', f'plan:={plan}', f'folder:={self.folder}']


def free_ports() -> tuple[int, int, int]:
    """Three free ports."""
    with socket.socket() as a, socket.socket() as b, socket.socket() as c:
        for each in (a, b, c):
            each.bind(('127.0.0.1', 0))
        return a.getsockname()[1], b.getsockname()[1], c.getsockname()[1]


class Launch:
    """One launch: its processes and its output.

    Args:
        words: the arguments of the launch.
        log: file for its output.
        clock: clock for the times of its lines.
        file: the launch file.
    """

    def __init__(self, words: Sequence[str], log: Path, clock: Clock, file: str = 'collect') -> None:
        self._clock = clock
        self.lines: list[tuple[int, str]] = []
        self.pids: dict[str, int] = {}
        self._log: IO[str] = log.open('w', encoding='utf-8')
        command = [sys.executable, '-m', 'tactile_nodes', 'launch', file, *words]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, name='launch output', daemon=True)
        self._reader.start()

    @property
    def status(self) -> int | None:
        """The exit status, or None while it runs."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """The process id of the launch itself."""
        return self._process.pid

    @property
    def questions(self) -> int:
        """How often the rig has asked for confirmation."""
        return sum(ACKNOWLEDGE in line for _, line in list(self.lines))

    def send(self, process: str, number: signal.Signals) -> None:
        """Send a signal to a program of the launch, or to the launch."""
        os.kill(self._pid(process), number)

    def fill_disk(self, process: str) -> None:
        """Limit the further growth of each file of a process to `ROOM_BYTES`."""
        pid = self._pid(process)
        files = (Path(each.path) for each in os.scandir(f'/proc/{pid}/fd'))
        largest = max((file.stat().st_size for file in files if file.is_file()), default=0)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (largest + ROOM_BYTES,) * 2)

    def lines_since(self, at_ns: int) -> list[str]:
        """The important lines from `at_ns` on, without progress."""
        found = []
        for stamp_ns, line in list(self.lines):
            match = _NODE.match(line)
            if stamp_ns >= at_ns and match is not None and match[2] and not _DULL.match(match[2]):
                found.append(match[2])
        return found

    @property
    def output(self) -> str:
        """All output so far."""
        return '\n'.join(line for _, line in list(self.lines))

    def interrupt(self, patience_s: float) -> None:
        """Interrupt the launch as with Ctrl-C, and `end` it."""
        if self.status is None:
            self.send('launch', signal.SIGINT)
        self.end(patience_s)

    def end(self, patience_s: float) -> None:
        """Wait until all its processes have ended; kill those that do not end in time."""
        deadline_ns = self._clock.now_ns() + round(patience_s * NS_PER_S)
        while self._alive() and self._clock.now_ns() < deadline_ns:
            self._clock.sleep_until(self._clock.now_ns() + NS_PER_S // 50)
        for pid in self._alive():
            os.kill(pid, signal.SIGKILL)
        self._process.wait()
        self._reader.join(2.0)
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._log.close()

    def _alive(self) -> list[int]:
        self._process.poll()
        return [pid for pid in (self._process.pid, *self.pids.values()) if _is_alive(pid)]

    def _pid(self, process: str) -> int:
        return self._process.pid if process == 'launch' else self.pids[process]

    def _read(self) -> None:
        assert self._process.stdout is not None
        for raw in self._process.stdout:
            line = raw.rstrip('\n')
            self.lines.append((self._clock.now_ns(), line))
            self._log.write(line + '\n')
            self._log.flush()
            if (match := _STARTED.search(line)) is not None:
                self.pids[match[1]] = int(match[2])


def _is_alive(pid: int) -> bool:
    try:
        return Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()[0] not in {'Z', 'X'}
    except OSError:
        return False


class Watcher:
    """Follows the run on the bus, and switches faults by the parameter service."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        press, state = topics.PRESS, topics.RIG_STATE
        self._presses = bus.subscribe(f'/{press.name}', press.type_name, Qos('queue', 1000))
        self._states = bus.subscribe(f'/{state.name}', state.type_name, Qos('queue', 1000))
        self.reported = 0
        self._depths = [0.0, 0.0]

    def await_press(self, after: int, patience_s: float, alive: Callable[[], bool]) -> None:
        """Wait until `after` presses are reported and the tip moves down in the gel.

        Raises:
            ConfigurationError: this did not happen in time.
        """
        deadline_ns = self._clock.now_ns() + round(patience_s * NS_PER_S)
        while self._clock.now_ns() < deadline_ns and alive():
            self._look()
            before, now = self._depths
            if self.reported >= after and now > TRIGGER_MM and before < now:
                return
            self._clock.sleep_until(self._clock.now_ns() + NS_PER_S // 200)
        raise ConfigurationError(f'the run came to {self.reported} presses, not to {after}; see its log')

    def switch(self, faults: Mapping[str, Value]) -> None:
        """Set parameters of the emulated rig, as ``tactile param set`` does.

        Raises:
            ConfigurationError: the rig refuses a parameter.
        """
        wanted = [types.Parameter(name=f'faults.{name}', value=to_message(value)) for name, value in faults.items()]
        request = types.SetParameters_Request(parameters=wanted)
        for result in self._bus.call(f'{RIG}/set_parameters', services.SET_PARAMETERS, request, 5.0).results:
            if not result.successful:
                raise ConfigurationError(result.reason)

    def switch_off(self, faults: Mapping[str, Value]) -> bool:
        """Reset these parameters; False if the rig has ended."""
        try:
            self.switch({name: type(value)() for name, value in faults.items()})
        except ServiceError:
            return False
        return True

    def close(self) -> None:
        """Close the subscriptions."""
        self._presses.close()
        self._states.close()

    def _look(self) -> None:
        while (received := self._presses.take()) is not None:
            self.reported += received.message.press > 0
        while (received := self._states.take()) is not None:
            depth_mm = received.message.depth * 1000
            if received.message.press and depth_mm != self._depths[1]:
                self._depths = [self._depths[1], depth_mm]


def answer() -> None:
    """Confirm that the rig was checked, as with ``tactile service call``."""
    bus = ZmqBus()
    try:
        with contextlib.suppress(ServiceError):  # the rig has ended meanwhile
            bus.call(ACKNOWLEDGE, services.TRIGGER, types.Trigger_Request(), 5.0)
    finally:
        bus.close()
