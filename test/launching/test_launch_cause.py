"""The last line of a launch that fails: why it failed."""

from __future__ import annotations

import os
import re

import pytest


@pytest.mark.parametrize(
    ('code', 'cause'),
    [
        ('import sys; print("camera: there is none", file=sys.stderr); sys.exit(1)', 'camera: there is none'),
        (
            'import sys; sys.stderr.write("[ERROR] [1.5] [camera]: gone\\n[INFO] [1.6] [a]: b\\n"); sys.exit(1)',
            '[camera]: gone',
        ),
        ('raise ValueError("a bug")', 'ValueError: a bug'),
        ('raise SystemExit(3)', 'exit code 3'),
        ('import os; os.kill(os.getpid(), 9)', 'it was killed by SIGKILL'),
        ('import os; os.kill(os.getpid(), 40)', 'it was killed by signal 40'),
        (
            'import os, sys; print("camera: a damaged picture", file=sys.stderr); os.kill(os.getpid(), 9)',
            'it was killed by SIGKILL; its last error: camera: a damaged picture',
        ),
    ],
)
def test_a_launch_that_fails_ends_with_the_cause(launch, program, code, cause):
    path, other = program(code), program('import time; time.sleep(60)', name='other')
    status, shown, _ = launch(
        f'- executable: {{cmd: {other}, output: screen}}\n'
        f'- executable: {{cmd: {path}, output: screen, on_exit: shutdown}}\n'
    )
    assert status == 1
    assert shown[-1] == f'[ERROR] [launch]: program-2 failed: {cause}'


def test_what_failed_before_is_part_of_the_cause(launch, program, tmp_path):
    """A rig that gave up leaves a calibrator that has no presses: the rig's reason is the one to read."""
    os.mkfifo(gate := tmp_path / 'gate')
    rig = program('import sys; print("rig: the lamp flickers", file=sys.stderr); sys.exit(3)', name='rig')
    waits = f'import sys; open("{gate}").read(); print("calibrator: no press", file=sys.stderr); sys.exit(1)'
    status, shown, _ = launch(
        f'- executable: {{cmd: {rig}, output: screen}}\n'
        f'- executable: {{cmd: {program(waits, name="calibrator")}, output: screen, on_exit: shutdown}}\n',
        {'[rig-1]: process has died': lambda service: gate.write_text('now')},
    )
    assert status == 1
    assert shown[-1] == (
        '[ERROR] [launch]: rig-1 failed: rig: the lamp flickers; then calibrator-2 failed: calibrator: no press'
    )


def test_a_required_program_that_is_missing_ends_the_launch_and_is_the_last_thing_reported(launch):
    status, shown, _ = launch('- executable: {cmd: sleep 60}\n- executable: {cmd: /no/such, on_exit: shutdown}\n')
    assert status == 1
    assert '[INFO] [launch]: process[such-2] was required: shutting down launched system' in shown
    assert shown[-1] == (
        '[ERROR] [launch]: such-2 failed: it could not be started: No such file or directory: /no/such'
    )


def test_a_missing_program_that_nobody_needs_is_reported_once_more_when_the_others_have_ended(launch):
    status, shown, _ = launch('- executable: {cmd: /no/such}\n- executable: {cmd: echo hi, output: screen}\n')
    assert status == 1
    assert '[ERROR] [such-1]: process could not be started: No such file or directory: /no/such' in shown
    assert '[echo-2] hi' in shown
    assert shown[-1] == (
        '[ERROR] [launch]: such-1 failed: it could not be started: No such file or directory: /no/such'
    )


def test_what_went_wrong_in_a_timer_is_the_last_thing_reported(launch):
    status, shown, _ = launch("""\
        - timer: {period: 0.05, children: [{log: {message: $(var none)}}]}
        - executable: {cmd: sleep 60}
        """)
    assert status == 1
    assert re.fullmatch(r"\[ERROR\] \[launch\]: .*test\.launch\.yaml:2: .*'none' does not exist.*", shown[-1])


def test_a_launch_that_is_reported_to_end_blames_nobody(launch, program):
    """One that nobody needs died before: the launch went on, and did not fail."""
    path = program('raise SystemExit(3)')
    status, shown, _ = launch(
        f'- executable: {{cmd: {path}}}\n- executable: {{cmd: sleep 60}}\n',
        {'process has died [pid': lambda service: service.shutdown('the test is over')},
    )
    assert status == 0
    assert not any('failed:' in line for line in shown)


def test_a_process_that_fails_silently_is_not_blamed_with_what_it_said_before_its_restart(launch, program, tmp_path):
    code = f"""\
        import os, sys
        if os.path.exists('{tmp_path}/again'): sys.exit(3)
        open('{tmp_path}/again', 'x')
        print('camera: a damaged picture', file=sys.stderr)
        os.kill(os.getpid(), 9)
        """
    options = "output: screen, on_exit: shutdown, respawn: 'true'"
    status, shown, _ = launch(f'- executable: {{cmd: {program(code)}, {options}}}\n')
    assert status == 1
    assert shown[-1] == '[ERROR] [launch]: program-1 failed: exit code 3'
