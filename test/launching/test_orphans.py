"""What a launched process leaves running: it ends with the launch, and hides nothing that was written."""

import os
import subprocess
import time

import pytest

from tactile_nodes.launching.processes import orphans


def test_a_grandchild_goes_with_its_parent(launch, program, tmp_path):
    path = program("""\
        import subprocess
        print('grandchild', subprocess.Popen(['sleep', '60']).pid, flush=True)
        """)
    _, shown, _ = launch(f'- executable: {{cmd: {path}, output: screen}}\n')
    [pid] = [int(line.split()[-1]) for line in shown if '] grandchild ' in line]
    assert not living(pid)


def test_a_grandchild_that_left_the_group_ends_with_the_launch(launch, program):
    path = program("""\
        import subprocess
        print('grandchild', subprocess.Popen(['sleep', '60'], start_new_session=True).pid, flush=True)
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


def test_a_process_that_becomes_another_program_keeps_its_mark():
    for _ in range(200):  # one in ten is looked at within the tenth of a millisecond that it takes
        with subprocess.Popen(['sleep', '60'], env={**os.environ, 'TACTILE_LAUNCH': 'mark-of-this'}) as process:
            try:
                assert b'mark-of-this' in orphans.environment(process.pid)
            finally:
                process.kill()


@pytest.mark.skipif(os.geteuid() != 0, reason='becomes another account')
def test_processes_of_other_accounts_are_not_waited_for(monkeypatch):
    """Of the hundred that a computer has each would take as long as one that becomes another program."""
    monkeypatch.setattr(orphans.time, 'sleep', lambda _: pytest.fail('waited for a process that tells nothing'))
    os.seteuid(65534)
    try:
        assert orphans.environment(1) == b''
    finally:
        os.seteuid(0)


def living(pid):
    return orphans.group_of(pid) is not None
