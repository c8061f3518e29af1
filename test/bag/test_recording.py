"""Which topics are recorded, and which messages are missed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tactile_nodes.bag import recording
from tactile_nodes.bag.recording import GapCounter, Tally, TopicFilter, folder_of
from tactile_nodes.errors import ConfigurationError

TOPICS = ['/image_raw', '/left/image_raw', '/force', '/rosout', '/chatter']


@pytest.mark.parametrize(
    ('choice', 'topics'),
    [
        ({}, ['/image_raw', '/left/image_raw']),
        ({'names': frozenset({'/force'})}, ['/force']),
        ({'names': frozenset({'/force'}), 'regex': '^/left'}, ['/left/image_raw', '/force']),
        ({'everything': True, 'exclude': 'image|rosout'}, ['/force', '/chatter']),
        ({'exclude': 'left'}, ['/image_raw']),
    ],
    ids=['the default', 'names alone', 'names and an expression', 'all but some', 'the default but some'],
)
def test_topics_are_recorded_as_they_were_chosen(choice: dict, topics: list[str]) -> None:
    chosen = TopicFilter(lambda topic: topic.endswith('image_raw'), **choice)
    assert [topic for topic in TOPICS if chosen.takes(topic)] == topics


def test_expression_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"'\(' is not a regular expression"):
        TopicFilter(lambda _: True, regex='(')


def test_each_publisher_counts_for_itself() -> None:
    gaps = GapCounter()
    assert [gaps.note('/force', who, number, 0) for who, number in (('a', 1), ('b', 9), ('a', 4))] == [0, 0, 2]


def test_old_number_is_no_gap() -> None:
    gaps = GapCounter()
    assert [gaps.note('/force', 'a', number, 0) for number in (5, 5, 3, 6)] == [0, 0, 0, 0]


MS = 1_000_000


def tally_of(topic: str, numbers: range, first_ns: int, period_ns: int) -> Tally:
    """A recording that began at 0."""
    tally = Tally()
    for step, number in enumerate(numbers):
        tally.note(topic, 'a', number, first_ns + step * period_ns)
    return tally


def test_messages_before_the_first_that_was_received_are_reckoned_from_its_pace() -> None:
    # Every 20 ms, the first after 1 s: 50 passed unheard, though its number, 900, shows more before the recording.
    tally = tally_of('/info', range(900, 930), 1000 * MS, 20 * MS)
    assert tally.lost_of(Counter()) == {'/info': 50}
    losses = tally.losses(Counter(), lambda topic: 'the rest can be used')
    assert losses == '; heard late: /info 1.0 s (about 50 messages); /info: the rest can be used'


def test_a_publisher_that_is_started_an_hour_later_is_not_said_to_be_an_hour_late() -> None:
    # Its first 19 messages, one every 20 ms, passed before the recorder was connected: 0.38 s.
    tally = tally_of('/image', range(20, 40), 3_600_000 * MS, 20 * MS)
    assert tally.losses(Counter(), lambda topic: 'lost') == (
        '; heard late: /image 0.4 s (about 19 messages); /image: lost'
    )


def test_a_slow_topic_heard_within_its_pace_is_not_late() -> None:
    assert not tally_of('/diagnostics', range(50, 60), 900 * MS, 1000 * MS).lost_of(Counter())


def test_a_topic_heard_from_its_first_message_on_is_not_late() -> None:
    assert not tally_of('/image', range(1, 30), 5000 * MS, 20 * MS).lost_of(Counter())


def test_a_camera_that_is_plugged_in_again_during_a_recording_is_not_said_to_be_late() -> None:
    """It had sent 5000 pictures before it was unplugged, and sends the next one half a minute after the beginning."""
    assert not tally_of('/image', range(5001, 5100), 30_000 * MS, 20 * MS).lost_of(Counter())


def test_what_comes_now_and_then_is_never_late() -> None:
    """Two lines of a log within a millisecond, after ten seconds without any: not the third and fourth were missed."""
    tally = Tally(is_steady=lambda topic: topic != '/rosout')
    for number, at_ns in ((5, 10_000 * MS), (6, 10_001 * MS)):
        tally.note('/rosout', 'a', number, at_ns)
    assert tally.losses(Counter(), str) == ''
    assert not tally.lost_of(Counter())


def test_losses_are_reported_by_topics_with_what_they_mean() -> None:
    tally = Tally()
    for number in (1, 2, 5):
        tally.note('/image', 'a', number, number)
    tally.malformed['/odd'] += 1
    meaning = {'/image': 'no forces', '/force': 'no forces', '/odd': 'nothing'}
    assert tally.losses(Counter({'/force': 3}), meaning.__getitem__) == (
        '; dropped by the slow disk: 3 of /force; lost on the way: 2 of /image; malformed: 1 of /odd'
        '; /force, /image: no forces; /odd: nothing'
    )


def test_a_recording_without_losses_says_nothing_of_them() -> None:
    assert tally_of('/image', range(1, 30), 0, 20 * MS).losses(Counter(), str) == ''


def test_two_dated_bags_of_the_same_second_have_two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after ``~/stop`` and ``~/start`` at once, or after the clock was set back."""
    monkeypatch.setattr(recording, 'wall_ns', lambda: 1_900_000_000_000_000_000)
    first = folder_of(f'{tmp_path}/')
    first.mkdir()
    assert folder_of(f'{tmp_path}/') == first.with_name(f'{first.name}_2')
