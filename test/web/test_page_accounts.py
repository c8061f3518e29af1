"""Which account a connection comes from, by the kernel's table of sockets."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_nodes.web.accounts import account_of, owners

HEAD = '  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n'
ROW = '   {n}: {peer} {here} {state} 00000000:00000000 00:00000000 00000000  {uid}        0 {inode} 1 0 20 0 0 10 -1\n'
PEER, HERE = ('127.0.0.1', 33710), ('127.0.0.1', 7470)
IN_TABLE = {'peer': '0100007F:83AE', 'here': '0100007F:1D2E', 'state': '01', 'uid': '1000', 'inode': '40150'}
pytestmark = pytest.mark.skipif(sys.byteorder != 'little', reason='the rows below are of a little-endian machine')


def table(folder: Path, *rows: dict[str, str]) -> list[Path]:
    file = folder / 'tcp'
    file.write_text(HEAD + ''.join(ROW.format(n=n, **(IN_TABLE | row)) for n, row in enumerate(rows)))
    return [file]


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    with socket.create_server(('127.0.0.1', 0)) as made:
        made.settimeout(10.0)
        yield made


def test_a_program_is_its_users_and_roots() -> None:
    assert owners() == {os.getuid(), 0}


def test_the_row_of_the_other_end_names_its_account(tmp_path: Path) -> None:
    ours = {'peer': IN_TABLE['here'], 'here': IN_TABLE['peer'], 'uid': '7'}
    assert account_of(PEER, HERE, table(tmp_path, ours, {})) == 1000


@pytest.mark.parametrize(
    'row',
    [
        pytest.param({'peer': '0100007F:83AF'}, id='another port'),
        pytest.param({'here': '0100007F:1D2F'}, id='to somebody else'),
        pytest.param({'uid': '0', 'inode': '0'}, id="closed by its program, and so shown as root's"),
        pytest.param({'peer': '0200007F:83AE'}, id='another address'),
    ],
)
def test_other_rows_name_nobody(tmp_path: Path, row: dict[str, str]) -> None:
    assert account_of(PEER, HERE, table(tmp_path, row)) is None


MAPPED = {name: '0000000000000000FFFF0000' + IN_TABLE[name] for name in ('peer', 'here')}
WIDE = {name: '00000000000000000000000001000000:' + IN_TABLE[name][-4:] for name in ('peer', 'here')}


@pytest.mark.parametrize(
    ('row', 'peer', 'here'),
    [
        pytest.param({'state': '05'}, PEER, HERE, id='has said all and still listens'),
        pytest.param(MAPPED, PEER, HERE, id='through IPv6 to an IPv4 address'),
        pytest.param(MAPPED, ('::ffff:127.0.0.1', 33710), HERE, id='the same, told by its IPv6 address'),
        pytest.param(WIDE, ('::1', 33710), ('::1', 7470), id='IPv6'),
    ],
)
def test_connections_of_all_kinds_are_known(
    tmp_path: Path, row: dict[str, str], peer: tuple[str, int], here: tuple[str, int]
) -> None:
    assert account_of(peer, here, table(tmp_path, row)) == 1000


def test_a_connection_of_this_process_is_ours(listening: socket.socket) -> None:
    with socket.create_connection(listening.getsockname()) as made:
        taken, peer = listening.accept()
        with taken:
            assert account_of(peer, made.getpeername()) == os.getuid()


def test_a_connection_that_its_program_has_closed_is_nobodys(listening: socket.socket) -> None:
    made = socket.create_connection(listening.getsockname())
    made.sendall(b'POST')
    made.close()
    taken, peer = listening.accept()
    with taken:
        assert account_of(peer, taken.getsockname()) is None


@pytest.mark.skipif(os.getuid() != 0, reason='only root can start a program of another account')
def test_a_program_of_another_account_is_known_as_its(listening: socket.socket) -> None:
    host, port = listening.getsockname()
    code = f'import os, socket; os.setuid(65534); s = socket.socket(); s.connect(({host!r}, {port})); input()'
    with subprocess.Popen([sys.executable, '-c', code], stdin=subprocess.PIPE) as other:
        taken, peer = listening.accept()
        with taken:
            assert account_of(peer, taken.getsockname()) == 65534
        other.communicate(b'\n')
