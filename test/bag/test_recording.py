"""Which topics are recorded, and which messages are missed."""

from __future__ import annotations

import pytest

from tactile_nodes.bag.recording import GapCounter, TopicFilter
from tactile_nodes.errors import ConfigurationError

TOPICS = ['/image_raw', '/left/image_raw', '/force', '/rosout', '/chatter']


def taken(**choice) -> list[str]:
    chosen = TopicFilter(lambda topic: topic.endswith('image_raw'), **choice)
    return [topic for topic in TOPICS if chosen.takes(topic)]


def test_without_a_choice_it_is_the_default_ones() -> None:
    assert taken() == ['/image_raw', '/left/image_raw']


def test_names_replace_the_default() -> None:
    assert taken(names=frozenset({'/force'})) == ['/force']


def test_expression_is_searched_for_and_adds_to_the_names() -> None:
    assert taken(names=frozenset({'/force'}), regex='^/left') == ['/left/image_raw', '/force']


def test_all_but_the_excluded() -> None:
    assert taken(everything=True, exclude='image|rosout') == ['/force', '/chatter']


def test_excluding_needs_nothing_else() -> None:
    assert taken(exclude='left') == ['/image_raw']


def test_expression_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"'\(' is no regular expression"):
        TopicFilter(lambda _: True, regex='(')


def test_each_publisher_counts_for_itself() -> None:
    gaps = GapCounter()
    assert [gaps.note('/force', 'a', 1), gaps.note('/force', 'b', 9), gaps.note('/force', 'a', 4)] == [0, 0, 2]


def test_old_number_is_no_gap() -> None:
    gaps = GapCounter()
    assert [gaps.note('/force', 'a', number) for number in (5, 5, 3, 6)] == [0, 0, 0, 0]
