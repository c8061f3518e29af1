"""The socket that the page is served on."""

from __future__ import annotations

import pytest

from tactile_nodes.errors import AddressInUseError, BusError
from tactile_nodes.web import port


def test_when_a_port_is_taken_the_next_one_serves() -> None:
    with port.listen('127.0.0.1', 0) as taken:
        number = taken.getsockname()[1]
        with port.listen('127.0.0.1', number) as other:
            assert number < other.getsockname()[1] < number + port.TRIES
            assert port.url(other) == f'http://127.0.0.1:{other.getsockname()[1]}/'


def test_when_all_are_taken_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port, 'TRIES', 1)
    with port.listen('127.0.0.1', 0) as taken, pytest.raises(AddressInUseError, match='page_port:='):
        port.listen('127.0.0.1', taken.getsockname()[1])


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(BusError, match=r'cannot serve the page on 192\.0\.2\.1 port 7470'):
        port.listen('192.0.2.1', 7470)
