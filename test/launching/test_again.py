"""A launch beside others: it reports why it ended, is started again, and ends when asked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.launching import again
from tactile_nodes.launching.again import LaunchedAgain
from tactile_nodes.launching.processes.output import Line, Screen
from tactile_nodes.launching.service import LaunchService

FAILS = """launch: [{executable: {cmd: "sh -c 'echo no camera >&2; exit 1'", on_exit: shutdown}}]"""
LASTS = """launch: [{executable: {cmd: "sleep 60"}}]"""


def until(happens: Callable[[], bool]) -> None:
    deadline_s = monotonic_s() + 60
    while not happens():
        assert monotonic_s() < deadline_s
        time.sleep(0.005)


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(again, 'FIRST_DELAY_S', 0.2)


@pytest.fixture
def started() -> Iterator[Callable[..., tuple[LaunchedAgain, list[Line]]]]:
    """Starts what is launched by these services; it ends with the test."""
    made: list[LaunchedAgain] = []

    def start(make: Callable[[Screen, int], LaunchService]) -> tuple[LaunchedAgain, list[Line]]:
        lines: list[Line] = []
        made.append(LaunchedAgain(make, lines.append))
        made[-1].start()
        return made[-1], lines

    yield start
    for tested in made:
        tested.stop()
        tested.join(50.0)  # less than the minute that it would last
        assert not tested._thread.is_alive()


@pytest.fixture
def launched(started: Callable, tmp_path: Path) -> Callable[..., tuple[LaunchedAgain, list[Line]]]:
    """Launches the first text at first, the last again and again; an empty one cannot be made."""

    def start(*texts: str) -> tuple[LaunchedAgain, list[Line]]:
        def make(screen: Screen, number: int) -> LaunchService:
            if not (text := texts[min(number, len(texts) - 1)]):
                raise ConfigurationError('there is no parameter file')
            file = tmp_path / f'{number}.launch.yaml'
            file.write_text(text)
            return LaunchService(file, screen=screen, log_base=tmp_path)

        return started(make)

    return start


def test_one_that_fails_is_reported_and_started_again_until_it_lasts(launched: Callable) -> None:
    tested, lines = launched(FAILS, LASTS)
    until(lambda: 'restarted' in tested.trouble)
    assert tested.trouble == 'restarted, not stable yet; last failure: sh-1 failed: no camera'
    until(lambda: any('sleep-1' in line.source for line in lines))


def test_one_that_ends_cleanly_is_not_blamed_with_what_it_had_survived(launched: Callable, tmp_path: Path) -> None:
    """A node that nobody needs dies, and then the recorded pictures end."""
    (tmp_path / 'fails').write_text('exit 1')
    gate = tmp_path / 'gate'
    waits = f'until test -e {gate}; do sleep 0.01; done'
    tested, lines = launched(
        f"""launch:
  - executable: {{cmd: "sh {tmp_path}/fails"}}
  - executable: {{cmd: "sh -c '{waits}'", on_exit: shutdown}}
""",
        LASTS,
    )
    until(lambda: any('has died' in line.text for line in lines))
    gate.touch()
    until(lambda: bool(tested.trouble))
    assert tested.trouble.removeprefix('restarted, not stable yet; last failure: ') == 'it ended'


def test_what_cannot_even_be_launched_is_reported(launched: Callable) -> None:
    tested, _ = launched('')
    until(lambda: tested.trouble == 'there is no parameter file')


@pytest.mark.parametrize(
    'error', [OSError(28, 'No space left on device', 'left.yaml'), RuntimeError("can't start new thread")]
)
def test_one_that_finds_no_room_is_reported_and_tried_again(
    started: Callable, tmp_path: Path, error: Exception
) -> None:
    """A full disk, a folder that somebody has cleared, or a container that allows no more threads."""
    full = [True]

    def make(screen: Screen, number: int) -> LaunchService:
        if full[0]:
            raise error
        (file := tmp_path / 'lasts.launch.yaml').write_text(LASTS)
        return LaunchService(file, screen=screen, log_base=tmp_path)

    tested, lines = started(make)
    until(lambda: str(error.args[-1]) in tested.trouble)
    full[0] = False
    until(lambda: any('sleep-1' in line.source for line in lines))


def test_of_failures_for_one_reason_only_the_last_leaves_its_logs(launched: Callable, tmp_path: Path) -> None:
    """A sensor without its camera is launched a thousand times a day. The last of these launches runs."""
    tested, lines = launched(FAILS, FAILS, FAILS.replace('camera', 'model'), LASTS)
    until(lambda: any('sleep-1' in line.source for line in lines))
    tested.stop()
    tested.join(60.0)
    left = sorted(tmp_path.glob('*/launch.log'))
    assert len([log for log in left if not log.parent.is_symlink()]) == 3
    assert (tmp_path / 'latest/launch.log').is_file()


def test_one_that_runs_is_no_trouble(launched: Callable) -> None:
    tested, lines = launched(LASTS)
    until(lambda: any('sleep-1' in line.source for line in lines))
    assert tested.trouble == ''


def test_one_that_works_again_is_no_trouble_before_it_has_settled(launched: Callable) -> None:
    tested, lines = launched(FAILS, FAILS, LASTS)
    until(lambda: tested.trouble == 'sh-1 failed: no camera')
    tested.report_works()  # too late, of the launch that has ended
    assert tested.trouble
    until(lambda: any('sleep-1' in line.source for line in lines))
    assert 'restarted' in tested.trouble
    tested.report_works()
    assert tested.trouble == ''


def test_one_that_has_settled_is_no_trouble_any_more(launched: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    tested, _ = launched(FAILS, LASTS)
    until(lambda: 'restarted' in tested.trouble)
    monkeypatch.setattr(again, 'SETTLED_S', 0.5)
    until(lambda: tested.trouble == '')
