"""What a launched process leaves running: it ends with the launch, and hides nothing that was written."""

import os
import signal
import subprocess
import threading
import time

import pytest

from tactile_nodes.launching.processes import child, orphans
from tactile_nodes.launching.processes.output import LaunchLog


@pytest.mark.parametrize('own_session', [False, True])
def test_a_grandchild_ends_with_the_launch_in_its_group_and_out_of_it(launch, program, own_session):
    path = program(f"""\
        import subprocess
        print('grandchild', subprocess.Popen(['sleep', '60'], start_new_session={own_session}).pid, flush=True)
        """)
    _, shown, _ = launch(f'- executable: {{cmd: {path}, output: screen}}\n')
    [pid] = [int(line.split()[-1]) for line in shown if '] grandchild ' in line]
    assert not living(pid)


def test_what_a_process_wrote_last_is_shown_though_something_holds_its_output_open(launch, program):
    path = program("""\
        import subprocess
        subprocess.Popen(['sleep', '60'], start_new_session=True)
        for number in range(30):
            print('line', number)
        """)
    slowly = {'] line ': lambda _: time.sleep(0.02)}
    _, shown, _ = launch(f'- executable: {{cmd: {path}, output: screen}}\n', slowly)
    assert [line.split()[-1] for line in shown if '] line ' in line] == [str(number) for number in range(30)]


def test_what_a_process_wrote_last_is_shown_before_its_end_however_late_it_is_read(launch, program, monkeypatch):
    take = LaunchLog.take

    def take_late(log, line, output):
        time.sleep(1.0 * (line.text == 'line 0'))  # as a thread that gets no processor
        take(log, line, output)

    monkeypatch.setattr(LaunchLog, 'take', take_late)
    path = program("print('line 0\\nline 1\\nline 2')")
    _, shown, _ = launch(f'- executable: {{cmd: {path}, output: screen}}\n')
    assert [line.split()[-1] for line in shown if '] line ' in line] == ['0', '1', '2']
    assert 'finished cleanly' in shown[-1]


def test_a_process_that_becomes_another_program_keeps_its_mark():
    for _ in range(200):  # one in ten is looked at within the tenth of a millisecond that it takes
        with subprocess.Popen(['sleep', '60'], env={**os.environ, 'TACTILE_LAUNCH': 'mark-of-this'}) as process:
            try:
                assert b'mark-of-this' in orphans.environment(process.pid)
            finally:
                process.kill()


def test_a_guardian_that_somebody_has_stopped_does_not_hold_up_the_end_of_a_launch():
    guardian = orphans.Guardian('mark-of-this')
    guardian._process.send_signal(signal.SIGSTOP)
    ending = threading.Thread(target=guardian.dismiss, daemon=True)
    ending.start()
    ending.join(60.0)
    assert not ending.is_alive()


@pytest.mark.skipif(os.geteuid() != 0, reason='becomes another account')
def test_processes_of_other_accounts_are_not_waited_for(monkeypatch):
    """Of the hundred that a computer has each would take as long as one that becomes another program."""
    monkeypatch.setattr(orphans.time, 'sleep', lambda _: pytest.fail('waited for a process that tells nothing'))
    os.seteuid(65534)
    try:
        assert orphans.environment(1) == b''
    finally:
        os.seteuid(0)


def test_a_process_of_another_account_is_named_and_the_others_are_ended(launch, monkeypatch):
    """As with launch-prefix: sudo. The person ends it, as the launch asks; the launch waits for that."""
    signalled = os.killpg
    foreign = []

    def refuse(leader, number):
        if leader in foreign:
            raise PermissionError(1, 'Operation not permitted')
        signalled(leader, number)

    def interrupt(service):
        foreign.append(service._supervisors[1]._child.pid)
        service.interrupt()

    def end_it(_):
        signalled(foreign[0], signal.SIGKILL)

    monkeypatch.setattr(child.os, 'killpg', refuse)
    actions = '- executable: {cmd: sleep 60}\n- executable: {cmd: sleep 61}\n'
    when = {'[sleep-2]: process started': interrupt, '[sleep-1]: process has died': end_it}
    status, shown, _ = launch(actions, when)
    assert status == 0
    assert [line for line in shown if 'may not be signalled' in line] == [
        '[ERROR] [sleep-2]: process[sleep-2] belongs to another user and may not be signalled; the launch waits for '
        f'it: end it with sudo kill {foreign[0]}'
    ]


def living(pid):
    return orphans.group_of(pid) is not None
