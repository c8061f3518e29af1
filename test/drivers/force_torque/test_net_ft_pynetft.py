"""An independent client of Net F/T boxes, pynetft from PyPI, uses the emulated one; skipped where it is missing."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from tactile_nodes.clock import SystemClock
from tactile_nodes.emulators.force_torque.net_ft import NetFtServer
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig

pynetft = pytest.importorskip('pynetft')

LOAD = (1.0, -2.0, 3.0, 0.1, 0.2, -0.3)


class Load:
    def wrench_at(self, time_ns: int) -> tuple[float, ...]:
        return LOAD


@pytest.fixture
def server() -> Iterator[NetFtServer]:
    config = NetFtConfig(name='Emulated', divider=14, counts_per_force=1000, counts_per_torque=50_000)
    with NetFtServer(NetFtBox(Load(), config), SystemClock()) as running:
        yield running


@pytest.fixture
def client(server: NetFtServer) -> Iterator[object]:
    config = pynetft.Config(sensor_host='127.0.0.1', rdt_port=server.rdt_port, http_port=server.http_port)
    with pynetft.Client(config, queue_size=1000) as running:
        assert running.wait_for_first_sample(30.0)
        yield running


def wait_for(condition) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_it_reads_the_configuration_and_the_wrench(client) -> None:
    sample = client.latest_sample()
    assert sample.wrench == pytest.approx(LOAD)
    configuration = client.health().sensor_configuration
    assert configuration.product_name == 'Emulated'
    assert configuration.calibration.counts_per_force_unit == 1000
    assert configuration.calibration.torque_unit == pynetft.TorqueUnit.NEWTON_METER


def test_it_counts_what_is_lost_doubled_late_and_malformed_as_it_was_asked_for(server: NetFtServer, client) -> None:
    faults = server.box.faults
    faults.lose, faults.duplicate, faults.swap, faults.malformed = 3, 2, 1, 1
    wait_for(lambda: client.health().out_of_order_count == 1)
    health = client.health()
    assert (health.duplicate_count, health.malformed_count) == (2, 1)
    assert health.lost_count == 3 + 1 + 1  # the malformed one, and the one that came late


def test_it_sees_a_stalled_front_end(server: NetFtServer, client) -> None:
    server.box.faults.stalled = True
    wait_for(lambda: client.health().ft_stall_count > 3)


def test_it_sees_a_status_fault(server: NetFtServer, client) -> None:
    server.box.faults.saturated = True
    wait_for(lambda: client.health().device_error_count > 3)
    assert client.health().last_status == 0x8002_0000
