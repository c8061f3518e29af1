"""Who may talk to the page's server."""

from __future__ import annotations

import pytest

from tactile_nodes.web import guard


@pytest.mark.parametrize('host', ['127.0.0.1:7470', 'localhost:7470', 'localhost', '[::1]:7470', '192.168.0.7:80'])
def test_addresses_and_this_machine_are_known(host: str) -> None:
    assert guard.is_known_host(host)


@pytest.mark.parametrize(
    'host',
    [
        'evil.example:7470',
        'localhost.evil.example',
        '',
        '[::1',
        '127.0.0.1.evil.example',
        '127.0.0.1:80;x',
        '127.0.0.1:80\n',
    ],
)
def test_a_name_that_somebody_pointed_here_is_not_known(host: str) -> None:
    assert not guard.is_known_host(host)


def test_a_name_is_known_when_it_was_given() -> None:
    assert guard.is_known_host('lab-pc:7470', {'lab-pc'})
    assert guard.is_known_host('lab-pc:7470', {'Lab-PC'})


@pytest.mark.parametrize(
    'origin', [None, 'null', 'http://evil.example', 'https://127.0.0.1:7470', 'http://127.0.0.1:80', '127.0.0.1:7470']
)
def test_another_page_is_not_our_own(origin: str | None) -> None:
    assert not guard.is_own_page(origin, '127.0.0.1:7470')


def test_the_page_that_was_loaded_from_here_is_our_own() -> None:
    assert guard.is_own_page('http://localhost:9000', 'localhost:9000')


@pytest.mark.parametrize(('address', 'own'), [('127.0.0.1', True), ('::1', True), ('0.0.0.0', False), ('lab', False)])
def test_loopback_is_what_only_this_machine_reaches(address: str, own: bool) -> None:
    assert guard.is_loopback(address) is own
