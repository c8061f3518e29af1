"""Cutting the parts out of a stream, whatever pieces it arrives in and whatever liberties the server takes."""

from __future__ import annotations

from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.drivers.camera.multipart import MultipartParser

BODIES = [b'\xff\xd8one\xff\xd9', b'\xff\xd8\r\n\r\ntwo--\xff\xd9', b'\xff\xd8three\xff\xd9']


def stream(lengths: bool = True, newline: bytes = b'\r\n', boundary: bytes = b'--cut') -> bytes:
    text = b''
    for body in BODIES:
        head = [boundary, b'Content-Type: image/jpeg', *([b'Content-Length: %d' % len(body)] * lengths), b'', b'']
        text += newline.join(head) + body + newline
    return text + boundary + newline


def bodies(parser: MultipartParser, *pieces: bytes) -> list[bytes]:
    return [part.body.rstrip(b'\r\n') for piece in pieces for part in parser.feed(piece, 0)]


@given(lengths=st.booleans(), cuts=st.lists(st.integers(1, 60), min_size=1, max_size=60))
def test_the_parts_do_not_depend_on_the_pieces(lengths: bool, cuts: list[int]) -> None:
    text = stream(lengths)
    marks = [0, *accumulate(cuts), len(text)]
    pieces = [text[a:b] for a, b in pairwise(marks)]
    assert bodies(MultipartParser('cut'), *pieces) == BODIES


@pytest.mark.parametrize('declared', ['cut', '--cut', '"cut"', '"--cut"'])
def test_the_boundary_may_be_declared_with_dashes_and_quotes(declared: str) -> None:
    assert bodies(MultipartParser(declared), stream()) == BODIES


@pytest.mark.parametrize(
    ('text', 'parts'),
    [
        pytest.param(stream(newline=b'\n'), BODIES, id='bare line feeds'),
        pytest.param(b'--cut\r\ncontent-length: 4\r\n\r\nabcd', [b'abcd'], id='before the next delimiter has come'),
        pytest.param(
            b'--cut\r\nContent-Length: 9000\r\n\r\nabcd\r\n' + stream(), [b'abcd', *BODIES],
            id='a length that is too great swallows nothing beyond the next delimiter',
        ),
        pytest.param(
            b'--cut\r\nContent-Length: 2\r\n\r\nabcd\r\n' + stream(), [b'ab', *BODIES],
            id='a length that is too small costs one part',
        ),
        pytest.param(b'\0\xff garbage --cu' * 50 + b'\r\n' + stream(), BODIES, id='garbage between parts'),
    ],
)  # fmt: skip
def test_parts_are_found_whatever_liberties_the_server_takes(text: bytes, parts: list[bytes]) -> None:
    assert bodies(MultipartParser('cut'), text) == parts


def test_a_part_is_stamped_when_its_first_byte_arrives() -> None:
    parser = MultipartParser('cut')
    assert parser.feed(b'--cut\r\nContent-Le', 100) == []
    assert parser.feed(b'ngth: 4\r\n\r\n', 200) == []
    assert parser.feed(b'a', 300) == []
    (part,) = parser.feed(b'bcd', 400)
    assert part.arrival_ns == 300


@pytest.mark.parametrize('lengths', [True, False])
def test_a_delimiter_that_is_sent_right_after_a_part_does_not_date_the_next_one_back(lengths: bool) -> None:
    """mjpg-streamer and many ESP32 cameras send it with the picture before, a frame's time too early."""
    parser, found = MultipartParser('cut'), parser_input(lengths)
    parts = [part for number, piece in enumerate(found) for part in parser.feed(piece, 100 * number)]
    assert [part.arrival_ns for part in parts] == [100, 200, 300]


def parser_input(lengths: bool) -> list[bytes]:
    """A delimiter, and then each part with the delimiter of the next one."""
    head, *rest = stream(lengths).split(b'--cut\r\n')
    return [head + b'--cut\r\n', *(part + b'--cut\r\n' for part in rest[:-1])]


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_no_bytes_break_it(pieces: list[bytes]) -> None:
    parser = MultipartParser('c')
    for piece in pieces:
        parser.feed(piece, 0)
    assert bodies(parser, b'\r\n\r\n\r\n--c\r\n\r\n\r\n--c\r\nContent-Length: 4\r\n\r\nabcd')[-1] == b'abcd'
