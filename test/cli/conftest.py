"""A system to look at: real participants on a bus of their own, seen by the command line from beside."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from running_system import DOMAIN, Ended, LampNode, Tactile

from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.cli.main import main


@pytest.fixture
def run_folder(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of this test alone, and its domain in the environment."""
    folder = tmp_path_factory.mktemp('r')
    folder.chmod(0o700)
    monkeypatch.setenv('TACTILE_RUN_DIR', str(folder))
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    return folder


@pytest.fixture
def other(run_folder: Path) -> Iterator[ZmqBus]:
    """Another participant of the bus that the commands join."""
    bus = ZmqBus(DOMAIN, folder=run_folder)
    yield bus
    bus.close()


@pytest.fixture
def tactile(capsys: pytest.CaptureFixture[str], run_folder: Path) -> Tactile:
    """Runs ``tactile`` with these words in this process."""

    def run(*words: str) -> Ended:
        capsys.readouterr()
        status = main(words)
        printed = capsys.readouterr()
        return Ended(status, printed.out, printed.err)

    return run


@pytest.fixture
def lamp(other: ZmqBus, spinning: Callable[[Node], Node]) -> Node:
    """A node that runs."""
    return spinning(LampNode(other))


@pytest.fixture
def repeating() -> Iterator[Callable[..., None]]:
    """Does something again and again, every few milliseconds, until the test has ended."""
    stop = threading.Event()
    threads: list[threading.Thread] = []

    def start(act: Callable[[], None], period_s: float = 0.005) -> None:
        def repeat() -> None:
            while not stop.wait(period_s):
                act()

        threads.append(threading.Thread(target=repeat))
        threads[-1].start()

    yield start
    stop.set()
    for thread in threads:
        thread.join()
