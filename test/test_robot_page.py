"""The page for robots says of each topic what the table of topics says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import TOPICS, Topic
from tactile_nodes.collection.guarded import GuardSettings

PAGE = (Path(__file__).parents[1] / 'docs/robots.md').read_text(encoding='utf-8')
ROWS = {
    cells[0].strip('`'): cells[1:]
    for line in PAGE.splitlines()
    if line.startswith('| `') and len(cells := [cell.strip() for cell in line.strip('|').split('|')]) == 6
}


def kept(qos: Qos) -> str:
    words = f'newest {qos.depth}' if qos.keep == 'latest' else f'queue of {qos.depth}'
    return f'{words}, latched' if qos.latched else words


def test_the_page_names_every_topic_and_no_other() -> None:
    assert ROWS.keys() == TOPICS.keys()


@pytest.mark.parametrize('topic', TOPICS.values(), ids=lambda topic: topic.name)
def test_type_rate_and_quality_of_service_are_those_of_the_table(topic: Topic) -> None:
    rate = '–' if topic.rate_hz is None else f'{topic.rate_hz:g}'
    assert ROWS[topic.name][:3] == [topic.type_name.replace('/msg/', '/'), rate, kept(topic.qos)]


def test_the_loop_is_told_with_the_numbers_that_it_has() -> None:
    told, text = GuardSettings(), re.sub(r'\s+', ' ', PAGE)
    assert f'one step of at most {told.step_mm:g} mm' in text
    assert (
        f'A step is {told.gain:g} of the missing force over the steepest stiffness expected '
        f'({told.stiffness_n_mm:g} N/mm)' in text
    )
    assert f'Within {told.band_n:g} N of the target' in text
    assert f'above {told.limit_n:g} N or older than {told.stale_ms:g} ms, after {told.travel_mm:g} mm' in text
    assert f'after {told.seconds:g} s' in text
