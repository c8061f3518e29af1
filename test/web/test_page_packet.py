"""What travels to the page."""

from __future__ import annotations

import math
import struct

import pytest
from seen import taken_apart

from tactile_nodes.web import packet


def test_a_message_is_length_json_sections_and_samples() -> None:
    message = packet.body({'age_s': 0.5}, {'bins': b'abcd'}) + packet.samples([(2.0, 0.5, math.nan)])
    text = b'{"age_s":0.5,"sections":[["bins",4]]}'
    assert message == struct.pack('<I', len(text)) + text + b'abcd' + struct.pack('<dff', 2.0, 0.5, math.nan)


def test_what_is_put_together_is_taken_apart_again() -> None:
    message = packet.body({'status': 'ok'}, {'bins': b'1234', 'image': b''}) + packet.samples([(1.0, 0.25, 0.5)] * 2)
    fields, sections, samples = taken_apart(message)
    assert fields == {'status': 'ok'}
    assert sections == {'bins': b'1234', 'image': b''}
    assert samples == [(1.0, 0.25, 0.5)] * 2


def test_numbers_that_are_none_become_null_wherever_they_stand() -> None:
    found = packet.finite({'a': math.nan, 'b': [math.inf, 1.0], 'c': ({'d': -math.inf},), 'e': 'nan'})
    assert found == {'a': None, 'b': [None, 1.0], 'c': [{'d': None}], 'e': 'nan'}


@pytest.mark.parametrize('text', ['größer als 0 µN', '"quoted" </script>'])
def test_words_of_nodes_travel_unchanged(text: str) -> None:
    assert taken_apart(packet.body({'text': text}, {}))[0] == {'text': text}
