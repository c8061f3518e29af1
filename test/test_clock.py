"""One time base for a host."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_nodes import clock
from tactile_nodes.errors import ConfigurationError


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A run folder of its own, in which nobody has said the anchor yet."""
    tmp_path.chmod(0o700)
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path))
    clock.anchor_ns.cache_clear()
    yield tmp_path
    clock.anchor_ns.cache_clear()


def _anchor_file(place: Path) -> Path:
    (file,) = place.glob('clock-*')
    return file


def assert_reads_as_date() -> None:
    """Between two looks at the date, which may be far apart on a loaded machine."""
    before_ns = time.time_ns()
    now_ns = clock.SystemClock().now_ns()
    assert before_ns - 50_000_000 < now_ns < time.time_ns() + 50_000_000


def test_stamps_read_as_dates(place: Path) -> None:
    assert_reads_as_date()


def test_stamp_is_the_monotonic_time_plus_one_constant(place: Path) -> None:
    assert clock.from_monotonic_ns(5) == 5 + clock.anchor_ns()
    before, now, after = time.monotonic_ns(), clock.SystemClock().now_ns(), time.monotonic_ns()
    assert before <= now - clock.anchor_ns() <= after


def test_all_processes_use_the_anchor_of_the_first(place: Path) -> None:
    program = 'from tactile_nodes import clock; print(clock.anchor_ns())'
    first = clock.anchor_ns()
    second = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True)
    assert int(second.stdout) == first


def test_of_many_who_come_first_one_is_believed(place: Path) -> None:
    found: list[int] = []
    threads = [threading.Thread(target=lambda: found.append(clock.anchor_ns())) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    clock.anchor_ns.cache_clear()
    assert set(found) == {clock.anchor_ns()}
    assert len(list(place.iterdir())) == 1


def test_who_logs_in_uses_the_anchor_of_a_service_that_runs_since_the_boot(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service comes to the folder of the login half a second later; its stamps stay as they are."""
    monkeypatch.delenv('TACTILE_RUN_DIR')
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(place / 'login'))
    monkeypatch.setattr('tactile_nodes.paths._LOGINS', str(place / 'none'))
    monkeypatch.setattr('tempfile.tempdir', str(place))
    of_service = clock.anchor_ns()
    clock.anchor_ns.cache_clear()
    (place / 'login').mkdir()
    assert clock.anchor_ns() == of_service
    assert int(_anchor_file(place / 'login/tactile').read_text()) == of_service


@pytest.mark.parametrize('text', ['', 'garbage', '1.5', '\udcff'])
def test_damaged_anchor_is_said_anew(place: Path, text: str) -> None:
    clock.anchor_ns()
    _anchor_file(place).write_bytes(text.encode('utf-8', 'surrogateescape'))
    clock.anchor_ns.cache_clear()
    assert int(_anchor_file(place).read_text() if (measured := clock.anchor_ns()) else '0') == measured
    assert_reads_as_date()


def test_removed_anchor_is_put_back_as_it_was(place: Path) -> None:
    said = clock.anchor_ns()
    _anchor_file(place).unlink()
    clock.keep_anchor()
    assert int(_anchor_file(place).read_text()) == said


def test_folder_that_cannot_be_written_is_a_sentence(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, 'write_text', full)
    with pytest.raises(ConfigurationError, match=r'No space left on device.*is the disk full'):
        clock.anchor_ns()


def test_system_clock_sleeps_until_the_deadline_and_not_when_it_is_past(place: Path) -> None:
    system = clock.SystemClock()
    deadline_ns = system.now_ns() + 20_000_000
    system.sleep_until(deadline_ns)
    assert system.now_ns() >= deadline_ns
    took_ns = []
    for _ in range(5):  # one of five is not held up, even on a loaded machine
        begin_ns = time.monotonic_ns()
        system.sleep_until(deadline_ns)
        took_ns.append(time.monotonic_ns() - begin_ns)
    assert min(took_ns) < 15_000_000


def test_stepped_clock_stands_still_until_it_is_moved() -> None:
    stepped = clock.SteppedClock(7)
    assert (stepped.now_ns(), stepped.now_ns()) == (7, 7)
    stepped.advance(1.5)
    assert stepped.now_ns() == 1_500_000_007


def test_stepped_clock_wakes_who_waits_for_its_time() -> None:
    stepped = clock.SteppedClock()
    woken: list[int] = []

    def wait() -> None:
        stepped.sleep_until(2_000_000_000)
        woken.append(stepped.now_ns())

    thread = threading.Thread(target=wait)
    thread.start()
    stepped.advance(1.0)
    assert woken == []
    stepped.advance(1.0)
    thread.join(30.0)
    assert woken == [2_000_000_000]
