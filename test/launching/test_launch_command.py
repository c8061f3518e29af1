"""`tactile launch` as a process among others: signals, terminals, and what is left when it is gone."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactile_nodes.launching.processes import orphans

ROOT = Path(__file__).resolve().parents[2]
MAIN = """\
import argparse, sys
from tactile_nodes.cli import launch
from tactile_nodes.errors import TactileError
parser = argparse.ArgumentParser()
launch.add_arguments(parser)
try:
    sys.exit(launch.run(parser.parse_args()))
except TactileError as error:
    sys.exit(str(error))
"""
# The terminal becomes the controlling one, so that Ctrl-C typed into it is a SIGINT.
AT_A_TERMINAL = 'import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n'

# A node that closes its file on SIGINT, with a grandchild that left its session.
NODE = """\
    import os, subprocess, time
    grandchild = subprocess.Popen(['sleep', '60'], start_new_session=True)
    print('grandchild', grandchild.pid, flush=True)
    try:
        print('ready', os.getpid(), flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        print('closed', flush=True)
    """


@pytest.fixture
def start(tmp_path):
    """Starts the command; whatever is left of it after the test is killed."""
    started = []

    def run(*words, main=MAIN, **options):
        environment = {**os.environ, 'PYTHONPATH': str(ROOT), 'ROS_LOG_DIR': str(tmp_path / 'logs')}
        process = subprocess.Popen(
            [sys.executable, '-c', main, *map(str, words)],
            env=environment,
            text=True,
            **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, **options},
        )
        started.append(process)
        return process

    yield run
    for process in started:
        if process.poll() is None:
            process.kill()
        process.wait(60)
        if process.stdout:
            process.stdout.close()


def read_until(stream, text):
    lines = []
    for line in stream:
        lines.append(line.rstrip())
        if text in line:
            return lines
    raise AssertionError(f'{text!r} did not come: {lines}')


def number_after(lines, word):
    return next(int(line.split()[-1]) for line in lines if f'] {word} ' in line)


def wait_until_gone(pids, seconds):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if not [pid for pid in pids if orphans.group_of(pid) is not None]:
            return
        time.sleep(0.02)
    raise AssertionError(f'still there after {seconds} s: {pids}')


@pytest.fixture
def running(start, launch_file, program):
    """A launch of one node whose node and grandchild are up: the launcher, and their process ids."""
    process = start(launch_file(f'- node: {{exec: {program(NODE)}, output: screen}}\n'))
    lines = read_until(process.stdout, '] ready')
    return process, [number_after(lines, 'grandchild'), number_after(lines, 'ready')]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_everything_cleanly_without_a_second_signal(running, number):
    process, pids = running
    process.send_signal(number)
    output = process.stdout.read()
    assert process.wait(30) == 0
    assert 'escalating' not in output
    assert '[program-1] closed' in output
    assert 'finished cleanly' in output
    wait_until_gone(pids, 0.5)


def test_a_launch_under_nohup_goes_on_when_its_terminal_closes(start, launch_file, program):
    main = f'import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{MAIN}'  # as nohup(1) starts it
    process = start(launch_file(f'- node: {{exec: {program(NODE)}, output: screen}}\n'), main=main)
    read_until(process.stdout, '] ready')
    status = Path(f'/proc/{process.pid}/status').read_text()
    ignored = int(status.partition('SigIgn:')[2].split()[0], 16)  # proc_pid_status(5): bit 0 is signal 1
    assert ignored & 1 << signal.SIGHUP - 1


def test_nothing_is_left_when_the_launcher_is_killed(running):
    process, pids = running
    process.kill()
    process.wait(30)
    wait_until_gone(pids, 60)


def test_a_node_can_close_its_file_when_the_launcher_is_killed(start, launch_file, program, tmp_path):
    path = program(f"""\
        import signal, sys, time
        signal.signal(signal.SIGINT, lambda *_: open({str(tmp_path / 'closed')!r}, 'w').close() or sys.exit())
        print('ready', flush=True)
        time.sleep(60)
        """)
    process = start(launch_file(f'- executable: {{cmd: {path}, output: screen}}\n'))
    read_until(process.stdout, '] ready')
    process.kill()
    deadline = time.monotonic() + 60
    while not (tmp_path / 'closed').exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert (tmp_path / 'closed').exists()


def test_ctrl_c_in_a_terminal_ends_everything_without_a_second_signal(start, launch_file, program):
    ours, theirs = os.openpty()
    file = launch_file(f'- node: {{exec: {program(NODE)}, output: screen}}\n')
    process = start(file, main=AT_A_TERMINAL + MAIN, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True)
    os.close(theirs)
    with os.fdopen(ours, 'r+b', buffering=0) as terminal:
        seen = b''
        while b'] ready' not in seen:
            seen += terminal.read(1000)
        terminal.write(b'\x03')
        assert process.wait(30) == 0
        with contextlib.suppress(OSError):  # EIO: the end
            while read := terminal.read(10_000):
                seen += read
    assert b'user interrupted with ctrl-c (SIGINT)' in seen
    assert b'escalating' not in seen
    assert b'[program-1] closed' in seen


def test_a_wrong_file_is_one_line_and_status_one(start, launch_file, tmp_path):
    process = start(launch_file('- node: {exe: a}\n'))
    output = process.stdout.read()
    assert process.wait(30) == 1
    assert output == f"{tmp_path}/test.launch.yaml:2: node: the key 'exec' is missing\n"


def test_an_argument_that_nothing_declares_is_refused_with_the_nearest_name(start, launch_file):
    process = start(launch_file('- arg: {name: source, default: a}\n'), 'sorce:=b')
    output = process.stdout.read()
    assert process.wait(30) == 1
    assert output == ("test.launch.yaml has no argument 'sorce'; did you mean 'source'? (--show-args lists them all)\n")


def test_a_launch_within_a_launch_leaves_nothing_either(start, launch_file, program):
    inner = launch_file(f'- node: {{exec: {program(NODE)}, output: screen}}\n', 'inner.launch.yaml')
    command = program(f'import sys; sys.argv[1:] = [{str(inner)!r}]\n{MAIN}', name='inner')
    command.write_text(command.read_text().replace(' -S', ''))
    process = start(launch_file(f'- executable: {{cmd: {command}, output: screen}}\n'))
    lines = read_until(process.stdout, '] ready')
    pids = [number_after(lines, 'grandchild'), number_after(lines, 'ready')]
    process.kill()
    process.wait(30)
    wait_until_gone(pids, 60)
