"""How participants find each other, and what becomes of their files."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import weakref
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
import zmq
from agents import NUMBER, Other, connected, until

from tactile_nodes.bus.protocol import Participant, Qos
from tactile_nodes.bus.zeromq.calls import bind_again
from tactile_nodes.bus.zeromq.discovery import Meeting, domain_from_environment
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.bus.zeromq.records import Record
from tactile_nodes.bus.zeromq.sockets import Longest, open_socket
from tactile_nodes.errors import BusError, ConfigurationError
from tactile_nodes.messages import types

Join = Callable[..., ZmqBus]
QUEUE = Qos('queue', 1000)


def remove(place: Path) -> None:
    """A folder, at once: one whose files go one by one may get new ones meanwhile, from those who miss theirs."""
    place.rename(aside := place.with_name('aside'))
    shutil.rmtree(aside)


@pytest.mark.parametrize('text', ['abc', '-1', '233', '1.5', '0x10', '1 2', 'ⅷ'])
def test_domain_that_is_none_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    with pytest.raises(ConfigurationError, match=r'ROS_DOMAIN_ID is .*; set it to a number from 0 to 232'):
        domain_from_environment()


@pytest.mark.parametrize(('text', 'domain'), [('', 0), ('0', 0), (' 7 ', 7), ('232', 232)])
def test_domain_is_a_number_from_0_to_232(monkeypatch: pytest.MonkeyPatch, text: str, domain: int) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    assert domain_from_environment() == domain


def test_folder_with_too_long_a_name_is_refused_in_a_sentence(folder: Path) -> None:
    with pytest.raises(BusError, match='is too long for sockets; set TACTILE_RUN_DIR'):
        ZmqBus(7, folder=folder / ('x' * 90))


def test_folder_that_cannot_be_made_is_refused_in_a_sentence(folder: Path) -> None:
    (folder / 'file').write_text('')
    with pytest.raises(BusError, match=r'cannot join the bus in .*: Not a directory'):
        ZmqBus(7, folder=folder / 'file')


def test_refused_bus_leaves_no_file_thread_or_descriptor_behind(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ZmqBus(7, folder=folder).close()  # what is loaded once is loaded now
    process = psutil.Process()
    before = (process.num_fds(), process.num_threads())

    def fail(*_: object) -> None:
        raise BusError('the disk is full')

    monkeypatch.setattr(Meeting, 'announce', fail)
    with pytest.raises(BusError, match='the disk is full'):
        ZmqBus(7, folder=folder)
    # Threads of others may have been ending just when they were counted.
    until(lambda: process.num_fds() <= before[0] and process.num_threads() <= before[1], 'all to be given back')
    assert list((folder / 'd7').iterdir()) == []


def test_closed_bus_leaves_no_file_thread_or_descriptor_behind(folder: Path) -> None:
    def use() -> None:
        bus, other = ZmqBus(7, folder=folder), ZmqBus(7, folder=folder)
        publisher = bus.advertise('/n', NUMBER, QUEUE)
        subscription = other.subscribe('/n', NUMBER, QUEUE)
        until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take())
        other.close()
        bus.close()

    use()
    process = psutil.Process()
    before = (process.num_fds(), process.num_threads())
    for _ in range(3):
        use()
    # Threads of others may have been ending just when they were counted.
    until(lambda: process.num_fds() <= before[0] and process.num_threads() <= before[1], 'all to be given back')
    assert list((folder / 'd7').iterdir()) == []


def test_files_of_a_killed_process_are_removed_by_who_comes_next(
    folder: Path, start: Callable[..., Other], join: Join
) -> None:
    other = start()
    other.advertise('/n')
    other.signal(signal.SIGKILL)
    assert len(list((folder / 'd7').iterdir())) == 4  # lock, record, two sockets
    bus = join()
    until(lambda: {file.name.split('.')[0] for file in (folder / 'd7').iterdir()} == {bus.uid})


def test_files_whose_lock_is_gone_are_removed_too(folder: Path, join: Join) -> None:
    (folder / 'd7').mkdir()
    for name in ('abcdabcd.json', 'abcdabcd.3.sock'):
        (folder / 'd7' / name).write_text('')
    join()
    assert not list((folder / 'd7').glob('abcdabcd.*'))


def test_nothing_is_remembered_of_participants_that_have_left(join: Join) -> None:
    watcher, other = join(), join()
    records = [weakref.ref(record) for record in watcher.peers()]
    assert len(records) == 1
    other.close()
    until(lambda: not watcher.peers() and not any(record() for record in records), 'the record to be forgotten')


def test_record_written_twice_at_once_is_read_anew(folder: Path, join: Join) -> None:
    bus, other = join(), join()
    for number in range(50):  # many of them within one tick of the file system's clock
        other.add_node(f'/node{number}')
        assert f'/node{number}' in bus.graph().nodes()


def test_publishers_of_a_process_that_has_made_a_hundred_thousand_are_heard(folder: Path, join: Join) -> None:
    """As a bridge does whose connection comes and goes for days: each time it speaks for the others anew."""
    bus, other = join(), join()
    bus._numbers = itertools.count(99_999)
    for name in ('/a', '/b'):
        publisher, subscription = bus.advertise(name, NUMBER, QUEUE), other.subscribe(name, NUMBER, QUEUE)
        until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take(), name)  # noqa: B023
    assert bus.next_number() == 100_001


def test_socket_whose_folder_is_removed_while_it_is_put_back_is_put_back_the_next_time(folder: Path) -> None:
    place = folder / 'd7' / '1.sock'
    address = f'ipc://{place}'
    place.parent.mkdir()
    with zmq.Context() as context, open_socket(context, zmq.ROUTER, Longest.CALL) as socket:
        socket.bind(address)
        shutil.rmtree(place.parent)
        for _ in range(2):
            with pytest.raises(BusError, match=f'^cannot be reached at {address}: No such file or directory$'):
                bind_again(socket, address, address)
        place.parent.mkdir()
        bind_again(socket, address, address)
        assert place.is_socket()


@pytest.mark.parametrize('told', [True, False], ids=['login', 'system service'])
def test_who_logs_in_again_meets_those_who_ran_on_after_the_last_logout(
    told: bool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """systemd removes the folder of a login at the last logout, and makes it again at the next login."""
    login, elsewhere = folder / f'{os.getuid()}', folder / 'tmp'
    monkeypatch.delenv('TACTILE_RUN_DIR', raising=False)
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(login) if told else '')
    monkeypatch.setattr('tactile_nodes.paths._LOGINS', str(folder / 'none' if told else folder))
    monkeypatch.setattr('tempfile.tempdir', str(elsewhere))
    login.mkdir()
    elsewhere.mkdir()
    buses = [ZmqBus(7), ZmqBus(7)]
    try:
        publisher, subscription = buses[0].advertise('/n', NUMBER, QUEUE), buses[1].subscribe('/n', NUMBER, QUEUE)
        until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take())
        remove(login)
        until(lambda: len(list(elsewhere.glob('*/d7/*.lock'))) == 2, 'both to meet elsewhere')
        login.mkdir()
        buses.append(ZmqBus(7))
        late = buses[2].subscribe('/n', NUMBER, QUEUE)
        while subscription.take():
            pass
        until(lambda: publisher.publish(types.Int64(data=2)) or (late.waiting and subscription.waiting), 'all to meet')
        until(lambda: len(buses[2].peers()) == 2, 'both to be back')
    finally:
        for bus in buses:
            bus.close()
    assert list(login.glob('tactile/d7/*')) == []


@pytest.mark.parametrize('ending', ['json', '0.sock', '*.sock', 'lock', '*', 'all of the folder'])
def test_whatever_is_removed_of_a_participants_files_is_put_back_and_newcomers_hear_it(
    folder: Path, join: Join, ending: str
) -> None:
    bus, publisher, subscription = connected(join)
    removed = list((folder / 'd7').glob(f'{bus.uid}.{"*" if " " in ending else ending}'))
    if ' ' in ending:
        remove(folder / 'd7')
    else:
        for file in removed:
            file.unlink()
    late = join().subscribe('/n', NUMBER, QUEUE)
    until(lambda: removed and all(file.exists() for file in removed), 'the files to come back')
    until(lambda: publisher.publish(types.Int64(data=2)) or (late.waiting and subscription.waiting), 'old and new ones')


@pytest.mark.parametrize('text', [b'', b'{', bytes(300), b'[]'])
def test_record_that_was_written_over_is_written_anew_and_meanwhile_the_last_one_counts(
    folder: Path, join: Join, text: bytes
) -> None:
    spoken, other = join(), join()
    spoken.add_node('/there')
    until(lambda: '/there' in other.graph().nodes())
    (folder / 'd7' / f'{spoken.uid}.json').write_bytes(text)
    assert '/there' in other.graph().nodes()
    until(lambda: (folder / 'd7' / f'{spoken.uid}.json').read_bytes() != text, 'it to speak again')


def test_folder_that_was_removed_does_not_say_that_everybody_is_gone(folder: Path) -> None:
    here, other = Meeting('aaaaaaaa', 7, folder), Meeting('bbbbbbbb', 7, folder)
    try:
        other.announce(Record(Participant('bbbbbbbb', 1, 'here'), (), other.socket_address(0)))
        assert [record.participant.uid for record in here.look()] == ['bbbbbbbb']
        shutil.rmtree(folder / 'd7')
        assert [record.participant.uid for record in here.look()] == ['bbbbbbbb']
        here.enter()
        assert here.look() == []
    finally:
        here.leave()
        other.leave()


def test_folder_that_cannot_be_made_again_is_reported_once_and_ends_nobody(
    folder: Path, join: Join, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder / 'place').mkdir(mode=0o700)
    (folder / 'd7').symlink_to('place')
    _, publisher, subscription = connected(join)
    (folder / 'file').write_text('in the way')
    (folder / 'link').symlink_to('file')
    (folder / 'link').replace(folder / 'd7')  # at once: whoever finds nothing there makes the folder again
    printed = ''

    def all_printed() -> str:
        nonlocal printed
        printed += capfd.readouterr().err
        return printed

    until(lambda: all_printed().count('cannot join the bus') >= 2, 'both to say so')
    while subscription.take():
        pass
    until(lambda: publisher.publish(types.Int64(data=2)) or subscription.take(), 'connections that stand to go on')
    (folder / 'd7').unlink()
    until(lambda: len(list(folder.glob('d7/*.lock'))) == 2, 'both to come back')
    assert all_printed().count('\n') == 2


def test_what_could_not_be_announced_on_a_full_disk_is_announced_once_there_is_room(
    folder: Path, join: Join, capfd: pytest.CaptureFixture[str]
) -> None:
    bus, other = join(), join()
    bus.add_node('/before')
    subscription = other.subscribe('/n', NUMBER, QUEUE)
    in_the_way = folder / 'd7' / f'.{bus.uid}.json'
    in_the_way.mkdir()  # instead of a full disk
    bus.add_node('/after')
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    printed: list[str] = []
    until(lambda: printed.append(capfd.readouterr().err) or any(printed), 'it to be said')
    assert 'cannot announce this process on the bus' in ''.join(printed)
    assert other.graph().nodes() == ['/before']
    in_the_way.rmdir()
    until(lambda: other.graph().nodes() == ['/after', '/before'], 'the node to be seen')
    until(lambda: publisher.publish(types.Int64(data=1)) or subscription.take(), 'the publisher to be heard')


def test_forked_child_does_not_keep_its_dead_parent_alive(folder: Path, join: Join) -> None:
    bus = join()
    read, write = os.pipe()
    parent = os.fork()
    if parent == 0:
        meeting = Meeting('abcdabcd', 7, folder)
        child = os.fork()
        if child > 0:
            os.write(write, f'{child}\n'.encode())
        signal.pause()
        meeting.leave()
    child = int(os.read(read, 20))
    assert (folder / 'd7' / 'abcdabcd.lock').exists()
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)
    try:
        until(lambda: not (folder / 'd7' / 'abcdabcd.lock').exists(), 'the dead one to be cleared away')
    finally:
        os.kill(child, signal.SIGKILL)
    assert bus.peers() == []
    os.close(read)
    os.close(write)
