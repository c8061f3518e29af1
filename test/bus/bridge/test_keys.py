"""Keys: made once, readable by their user alone, never overwritten, and distinguished."""

from __future__ import annotations

import argparse
import stat
import subprocess
from pathlib import Path

import pytest

from tactile_nodes.bus.bridge.keys import create_keys, read_pair, read_public
from tactile_nodes.bus.bridge.talk import ClockOffset
from tactile_nodes.cli import keys as verb
from tactile_nodes.errors import ConfigurationError


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv('TACTILE_KEYS', str(tmp_path / 'keys'))
    return tmp_path / 'keys'


def _run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    return verb.run(parser.parse_args(words))


def test_created_keys_can_be_read_and_fit_together(place: Path) -> None:
    public, secret = create_keys('robot')
    pair = read_pair('robot')
    assert read_pair(str(secret)) == pair
    assert pair.public == read_public('robot') == read_public(str(public))
    assert pair.secret not in public.read_bytes()
    assert pair.secret.decode() not in repr(pair)


def test_keys_and_their_folder_are_the_users_alone(place: Path) -> None:
    for file in create_keys('robot'):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(place.stat().st_mode) == 0o700


def test_keys_are_not_overwritten(place: Path) -> None:
    public, secret = create_keys('robot')
    before = secret.read_bytes()
    for _ in range(2):
        with pytest.raises(ConfigurationError, match="keys named 'robot' already exist"):
            create_keys('robot')
        public.unlink(missing_ok=True)
    assert secret.read_bytes() == before


@pytest.mark.parametrize('name', ['', '../robot', 'a/b', 'a b'])
def test_name_that_would_leave_the_folder_is_refused(place: Path, name: str) -> None:
    with pytest.raises(ConfigurationError, match='is not a valid key name'):
        create_keys(name)


def test_secret_key_that_others_may_read_is_refused(place: Path) -> None:
    _, secret = create_keys('robot')
    secret.chmod(0o644)
    with pytest.raises(ConfigurationError, match=r'the secret key .* is readable by others; fix it with: chmod 600'):
        read_pair('robot')


def test_secret_key_in_the_place_of_a_public_one_is_refused(place: Path) -> None:
    _, secret = create_keys('robot')
    with pytest.raises(ConfigurationError, match='the secret key must not leave its machine'):
        read_public(str(secret))


def test_missing_and_damaged_keys_say_what_to_do(place: Path) -> None:
    with pytest.raises(ConfigurationError, match='tactile keys create NAME'):
        read_pair('robot')
    with pytest.raises(ConfigurationError, match=r'on the other machine to .*lab\.key'):
        read_public('lab')
    place.mkdir()
    (place / 'lab.key').write_text('rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7\n')  # as of 0.1: Z85, of ZeroMQ's RFC 32
    with pytest.raises(
        ConfigurationError,
        match=r'contains no key \(keys made before 0\.2\.0 are not valid: create new ones on each machine\)',
    ):
        read_public('lab')


def test_command_makes_and_shows_keys(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run('create', 'robot') == 0
    assert str(place / 'robot.key') in capsys.readouterr().out
    assert _run('show') == 0
    name, fingerprint, whose = capsys.readouterr().out.split()
    assert (name, whose) == ('robot', 'own')
    assert _run('show', 'robot') == 0
    assert capsys.readouterr().out == (place / 'robot.key').read_text()
    words = ['openssl', 'x509', '-in', str(place / 'robot.key'), '-noout', '-fingerprint', '-sha256']
    openssl = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    assert openssl.partition('=')[2].strip().replace(':', '').lower() == fingerprint


@pytest.mark.parametrize(
    'content', ['not a key', '-----BEGIN CERTIFICATE-----\nA\n-----END CERTIFICATE-----\n'], ids=['text', 'damaged']
)
def test_a_file_that_is_no_key_is_named_and_hides_none_that_is(
    place: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    for name in ('robot', 'arm'):
        create_keys(name)
    (place / 'lab.key').write_text(content)
    assert _run('show') == 0
    printed = capsys.readouterr()
    assert [line.split()[0] for line in printed.out.splitlines()] == ['arm', 'robot']
    assert 'lab.key was skipped' in printed.err


def test_command_says_that_there_are_none(place: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'no keys in .*; create some with: tactile keys create NAME'):
        _run('show')


def test_clock_of_another_machine_is_measured_by_the_quickest_exchange() -> None:
    ahead_ns, quick_ns, slow_ns = 5_000_000, 200, 90_000
    clock = ClockOffset()
    for there_ns, back_ns in ((slow_ns, 0), (quick_ns // 2, quick_ns // 2), (0, slow_ns)):
        clock.hear(1_000, 1_000 + there_ns + ahead_ns, 1_000 + there_ns + back_ns)
    assert clock.ahead_ns == ahead_ns
