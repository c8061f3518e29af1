"""A process of a rig asks to come before what only computes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tactile_nodes.bus.node import priority
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory

REPORTING = """
import os, threading
from tactile_nodes.bus.node import priority
priority.take_priority()
given = []
thread = threading.Thread(target=lambda: given.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id())))
thread.start()
thread.join()
session = (priority.SESSION.read_text().split() if priority.SESSION.exists() else [])[-1:]
print(os.getpriority(os.PRIO_PROCESS, 0), *given, ''.join(session), priority.lacking(), sep=';')
"""


ENDING = """
import os, threading
from tactile_nodes.bus.node import priority
priority.take_priority()
ended = threading.Event()
thread = threading.Thread(target=ended.wait)
thread.start()
priority.restore_priority()
session = (priority.SESSION.read_text().split() if priority.SESSION.exists() else [])[-1:]
print(*(os.getpriority(os.PRIO_PROCESS, each) for each in (0, thread.native_id)), ''.join(session), sep=';')
ended.set()
"""


def report_of(nice: str, session: bool = True, program: str = REPORTING) -> list[str]:
    """Niceness of the process, of a thread that it starts, of its session; and what it says to a person."""
    done = subprocess.run(
        [sys.executable, '-c', program],
        env={**os.environ, priority.VARIABLE: nice},
        capture_output=True,
        text=True,
        check=True,
        start_new_session=session,
    )
    return done.stdout.strip().split(';')


def test_the_niceness_asked_for_is_that_of_the_process_its_threads_and_its_session() -> None:
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    wanted = str(min(19, usual + 3))  # any account may be nicer than it is
    process, thread, session, lacks = report_of(wanted)
    assert (process, thread, lacks) == (wanted, wanted, '')
    assert session in {wanted, ''}


def test_a_session_that_others_lead_is_left_as_it_is() -> None:
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    before = priority.SESSION.read_text(encoding='ascii').split()[-1:] if priority.SESSION.exists() else []
    _, _, session, _ = report_of(str(min(19, usual + 3)), session=False)
    assert session == ''.join(before)  # empty where the kernel has no group for this session


def test_who_is_asked_to_end_waits_for_others_no_longer() -> None:
    """Beside programs that compute, a process of niceness 19 needed longer than the ten seconds that a launch gives."""
    process, thread, session = report_of('19', program=ENDING)
    assert session in {'0', ''}
    if os.geteuid() == 0:
        assert (process, thread) == ('0', '0')


def test_an_account_that_may_not_is_reported_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: int) -> None:
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setenv(priority.VARIABLE, '-20')
    monkeypatch.setattr(os, 'setpriority', refused)
    priority.take_priority()
    assert 'may not raise process priority (niceness -20 wanted, ' in priority.lacking()


def test_nothing_is_changed_or_said_where_nothing_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(priority.VARIABLE, raising=False)
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    priority.take_priority()
    assert (os.getpriority(os.PRIO_PROCESS, 0), priority.lacking()) == (usual, '')


@pytest.mark.parametrize('text', ['high', '20', '-21', '1.5'])
def test_what_is_no_niceness_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv(priority.VARIABLE, text)
    with pytest.raises(ConfigurationError, match=f"TACTILE_NICE is '{text}'; set it to an integer"):
        priority.take_priority()


@pytest.mark.parametrize('name', ['collect', 'calibrate'])
def test_launches_of_rigs_put_what_drives_and_what_plays_a_machine_first(name: str) -> None:
    text = Path(share_directory() / 'launch' / f'{name}.launch.yaml').read_text(encoding='utf-8')
    nodes = [entry['node'] for entry in yaml.safe_load(text)['launch'] if 'node' in entry]
    urgent = [node for node in nodes if node['exec'] == 'rig_node' or 'emulated_rig' in node.get('args', '')]
    assert len(urgent) >= 3
    for node in urgent:
        assert {'name': priority.VARIABLE, 'value': '-10'} in node.get('env', [])
