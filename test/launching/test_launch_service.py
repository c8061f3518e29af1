"""A launch file being run: real processes, started, watched, started again and ended."""

import os
import re
import threading
from pathlib import Path

import pytest

from tactile_nodes import paths
from tactile_nodes.launching.service import LaunchService


def stop(service):
    service.shutdown('the test is over')


def interrupt(service):
    service.interrupt()


def without_numbers(lines):
    return [re.sub(r'pid (\[?)\d+', r'pid \1N', line) for line in lines]


def test_the_lines_of_a_launch_are_those_of_ros(launch, program):
    path = program('print("hello")')
    status, shown, service = launch(f'- node: {{exec: {path}, name: n, output: screen}}\n')
    assert status == 0
    assert without_numbers(shown) == [
        f'[INFO] [launch]: All log files can be found below {service.log_folder}',
        '[INFO] [launch]: Default logging verbosity is set to INFO',
        '[INFO] [program-1]: process started with pid [N]',
        '[program-1] hello',
        '[INFO] [program-1]: process has finished cleanly [pid N]',
    ]


def test_a_process_that_died_is_named_with_its_code_and_its_command_is_in_the_log(launch, program):
    path = program('raise SystemExit(3)')
    status, shown, service = launch(f'- executable: {{cmd: {path} a b}}\n')
    assert status == 0
    assert without_numbers(shown)[-1] == '[ERROR] [program-1]: process has died [pid N, exit code 3].'
    assert f"cmd='{path} a b'" in (service.log_folder / 'launch.log').read_text()


def test_a_node_gets_its_words_and_its_parameter_file(launch, program):
    path = program('import sys; print(sys.argv[1:6]); print(open(sys.argv[-1]).read())')
    _, shown, _ = launch(
        f'- node: {{exec: {path}, name: n, namespace: skin, output: screen, param: [{{name: rate, value: 30.0}}]}}\n'
    )
    assert "[program-1] ['--ros-args', '-r', '__node:=n', '-r', '__ns:=/skin']" in shown
    assert '[program-1]     rate: 30.0' in shown


def test_python_nodes_do_not_hold_their_output_back(launch, program):
    path = program("""\
        import time
        print('ready')
        time.sleep(60)
        """)
    status, _, _ = launch(f'- node: {{exec: {path}, output: screen}}\n', {'] ready': stop})
    assert status == 0


# --- respawn ---------------------------------------------------------------------------------------------------------


def test_a_process_is_started_again_as_often_as_allowed_even_after_a_clean_end(launch):
    status, shown, _ = launch("- executable: {cmd: 'true', respawn: 'true', respawn_max_retries: 2}\n")
    assert status == 0
    assert sum('process started' in line for line in shown) == 3
    assert sum('finished cleanly' in line for line in shown) == 3


def test_a_process_is_not_started_again_during_shutdown(launch, program):
    path = program("""\
        import time
        print('ready')
        time.sleep(60)
        """)
    _, shown, _ = launch(f"- executable: {{cmd: {path}, respawn: 'true', output: screen}}\n", {'] ready': stop})
    assert sum('process started' in line for line in shown) == 1


def test_a_shutdown_ends_the_wait_for_a_respawn(launch):
    status, shown, _ = launch(
        "- executable: {cmd: 'true', respawn: 'true', respawn_delay: 50.0}\n", {'finished cleanly': stop}
    )
    assert status == 0
    assert sum('process started' in line for line in shown) == 1


# --- required processes ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(('command', 'expected'), [('true', 0), ('false', 1)])
def test_the_launch_ends_with_a_required_process_and_fails_with_it(launch, command, expected):
    status, shown, _ = launch(f"""\
        - executable: {{cmd: sleep 60}}
        - executable: {{cmd: '{command}', on_exit: shutdown, respawn: 'true'}}
        """)
    assert status == expected
    assert f'[INFO] [launch]: process[{command}-2] was required: shutting down launched system' in shown
    assert "[INFO] [sleep-1]: sending signal 'SIGINT' to process[sleep-1]" in shown


def test_a_required_process_that_dies_of_the_shutdown_is_no_failure(launch):
    status, _, _ = launch('- executable: {cmd: sleep 60, on_exit: shutdown}\n', {'process started': stop})
    assert status == 0


# --- the end ---------------------------------------------------------------------------------------------------------

STUBBORN = """\
    import signal, sys, time
    signal.signal(signal.SIGINT, {sigint})
    signal.signal(signal.SIGTERM, signal.{sigterm})
    print('ready', flush=True)
    while True:
        time.sleep(60)
    """


def test_a_process_that_ignores_sigint_gets_sigterm_after_its_timeout(launch, program):
    path = program(STUBBORN.format(sigint='signal.SIG_IGN', sigterm='SIG_DFL'))
    status, shown, _ = launch(
        f'- executable: {{cmd: {path}, output: screen, sigterm_timeout: 0.2}}\n', {'] ready': stop}
    )
    assert status == 0
    assert without_numbers(shown)[-5:] == [
        '[INFO] [launch]: shutting down: the test is over',
        "[INFO] [program-1]: sending signal 'SIGINT' to process[program-1]",
        "[ERROR] [program-1]: process[program-1] failed to terminate '0.2' seconds after receiving 'SIGINT', "
        "escalating to 'SIGTERM'",
        "[INFO] [program-1]: sending signal 'SIGTERM' to process[program-1]",
        '[ERROR] [program-1]: process has died [pid N, exit code -15].',
    ]


def test_a_process_that_ignores_sigterm_too_is_killed_after_the_sum_of_the_timeouts(launch, program):
    path = program(STUBBORN.format(sigint='signal.SIG_IGN', sigterm='SIG_IGN'))
    _, shown, _ = launch(
        f'- executable: {{cmd: {path}, output: screen}}\n',
        {'] ready': stop},
        arguments={'sigterm_timeout': '0.2', 'sigkill_timeout': '0.3'},
    )
    assert (
        "[ERROR] [program-1]: process[program-1] failed to terminate '0.5' seconds after receiving 'SIGTERM', "
        "escalating to 'SIGKILL'"
    ) in shown
    assert 'exit code -9' in shown[-1]


def test_a_second_ctrl_c_is_ignored(launch, program):
    path = program(
        STUBBORN.format(
            sigint="lambda *_: print('tidying', flush=True) or time.sleep(0.6) or sys.exit(0)", sigterm='SIG_DFL'
        )
    )
    status, shown, _ = launch(
        f'- executable: {{cmd: {path}, output: screen}}\n', {'] ready': interrupt, '] tidying': interrupt}
    )
    assert status == 0
    assert '[WARNING] [launch]: user interrupted with ctrl-c (SIGINT)' in shown
    assert '[WARNING] [launch]: user interrupted with ctrl-c (SIGINT) again, ignoring...' in shown
    assert 'finished cleanly' in shown[-1]


def test_ctrl_c_at_a_terminal_does_not_name_the_signals(launch):
    _, shown, _ = launch('- executable: {cmd: sleep 60}\n', {'process started': interrupt}, interactive=True)
    assert not any('sending signal' in line for line in shown)
    assert 'exit code -2' in shown[-1]


def test_an_empty_launch_ends_at_once(launch):
    assert launch('- log: {message: nothing to do}\n')[0] == 0


def test_a_wrong_file_starts_nothing(launch):
    status, shown, _ = launch('- executable: {cmd: echo hi}\n- log: {message: $(var none)}\n')
    assert status == 1
    assert not any('process started' in line for line in shown)
    assert '.launch.yaml:3: $(var none): the launch configuration' in shown[-1]


def test_the_service_runs_in_any_thread_and_is_stopped_from_another(launch):
    results = []
    started = threading.Event()
    services = []

    def note(service):
        services.append(service)
        started.set()

    thread = threading.Thread(
        target=lambda: results.append(launch('- executable: {cmd: sleep 60}\n', {'process started': note}))
    )
    thread.start()
    assert started.wait(60)
    services[0].shutdown()
    thread.join(60)
    assert results[0][0] == 0


# --- timers and shutdown ---------------------------------------------------------------------------------------------


def test_a_timer_starts_its_processes_later(launch):
    status, shown, _ = launch("""\
        - timer: {period: 0.1, children: [{executable: {cmd: echo late, output: screen}}]}
        - executable: {cmd: echo early, output: screen}
        """)
    assert status == 0
    # Numbers are given when an action runs, so the later process has the higher one. It may be the first to write.
    assert sorted(line for line in shown if line.startswith('[echo')) == ['[echo-1] early', '[echo-2] late']
    started = [line for line in shown if 'process started' in line]
    assert ['[echo-1]' in line for line in started] == [True, False]


def test_a_shutdown_cancels_timers_but_those_that_say_otherwise(launch):
    _, shown, _ = launch("""\
        - timer: {period: 0.1, children: [{log: {message: cancelled}}]}
        - timer: {period: 0.1, cancel_on_shutdown: false, children: [{log: {message: kept}}]}
        - shutdown: {reason: enough}
        """)
    assert '[INFO] [launch]: shutting down: enough' in shown
    assert '[INFO] [launch.user]: kept' in shown
    assert '[INFO] [launch.user]: cancelled' not in shown


# --- the child's world -----------------------------------------------------------------------------------------------


def test_a_shell_command_is_run_by_a_shell(launch):
    _, shown, _ = launch(
        '- executable: {cmd: "echo $A | tr a b", shell: true, output: screen, env: [{name: A, value: xa}]}\n'
    )
    assert '[echo-1] xb' in shown


def test_cwd_is_the_folder_of_the_process(launch, tmp_path):
    _, shown, _ = launch('- executable: {cmd: pwd, cwd: $(dirname), output: screen}\n')
    assert f'[pwd-1] {tmp_path}' in shown


def test_a_terminal_is_emulated_on_request(launch, program):
    path = program('import sys; print(sys.stdout.isatty(), sys.stderr.isatty())')
    actions = f'- executable: {{cmd: {path}, output: screen, emulate_tty: %s}}\n'
    assert '[program-1] True True' in launch(actions % 'true')[1]
    assert '[program-1] False False' in launch(actions % 'false')[1]


def test_a_last_line_without_an_end_is_shown_also_in_a_terminal(launch, program):
    path = program('print("why", end="")')
    for emulated in ('true', 'false'):
        shown = launch(f'- executable: {{cmd: {path}, output: screen, emulate_tty: {emulated}}}\n')[1]
        assert '[program-1] why' in shown


def test_standard_input_stays_open_and_empty(launch, program):
    path = program("""\
        import select, sys
        print(select.select([sys.stdin], [], [], 0.2)[0])
        """)
    assert '[program-1] []' in launch(f'- executable: {{cmd: {path}, output: screen}}\n')[1]


# --- output ----------------------------------------------------------------------------------------------------------

BOTH = 'import sys; print("out"); print("err", file=sys.stderr)'


@pytest.mark.parametrize(
    ('output', 'on_screen', 'in_log', 'own'),
    [
        ('log', {'err'}, {'out', 'err'}, False),
        ('screen', {'out', 'err'}, set(), False),
        ('both', {'out', 'err'}, {'out', 'err'}, False),
        ('own_log', set(), set(), True),
        ('full', {'out', 'err'}, {'out', 'err'}, True),
    ],
)
def test_output_goes_where_its_option_says(launch, program, output, on_screen, in_log, own):
    path = program(BOTH)
    _, shown, service = launch(f'- executable: {{cmd: {path}, output: {output}}}\n')
    log = (service.log_folder / 'launch.log').read_text()
    assert {word for word in ('out', 'err') if f'[program-1] {word}' in shown} == on_screen
    assert {word for word in ('out', 'err') if f'[program-1] {word}' in log} == in_log
    assert {file.name for file in service.log_folder.iterdir()} == {'launch.log'} | (
        {'program-1.log', 'program-1-stdout.log', 'program-1-stderr.log'} if own else set()
    )
    if own:
        assert (service.log_folder / 'program-1-stdout.log').read_text() == '[program-1] out\n'
        assert (service.log_folder / 'program-1-stderr.log').read_text() == '[program-1] err\n'


def test_the_environment_overrides_every_output(launch, program, monkeypatch):
    monkeypatch.setenv('OVERRIDE_LAUNCH_PROCESS_OUTPUT', 'screen')
    path = program(BOTH)
    assert '[program-1] out' in launch(f'- executable: {{cmd: {path}, output: own_log}}\n')[1]


def test_a_path_that_is_not_utf_8_ends_no_launch(launch):
    path = os.fsdecode(b'/gr\xf6\xdfe.yaml')  # "größe" in Latin-1, as of an archive of another system
    status, _, service = launch(
        "- arg: {name: config}\n- log: {message: '$(var config)'}\n", arguments={'config': path}
    )
    assert status == 0
    line = r'[INFO] [launch.user]: /gr\udcf6\udcdfe.yaml'
    assert line in (service.log_folder / 'launch.log').read_text()


def test_latest_leads_to_the_log_which_has_the_time_in_front(launch, tmp_path):
    launch('- log: {message: a}\n')
    _, _, service = launch('- log: {message: b}\n')
    latest = tmp_path / 'logs' / 'latest'
    assert latest.resolve() == service.log_folder
    assert re.search(r'^\d+\.\d{7} \[INFO\] \[launch\.user\]: b$', (latest / 'launch.log').read_text(), re.M)


def test_a_screen_that_is_gone_does_not_stop_the_launch(tmp_path, launch_file):
    def gone(_):
        raise BrokenPipeError

    service = LaunchService(launch_file('- executable: {cmd: echo a}\n'), screen=gone, log_base=tmp_path / 'logs')
    assert service.run() == 0


def test_debug_names_each_command(launch):
    _, shown, _ = launch('- executable: {cmd: echo a}\n', debug=True)
    assert "[DEBUG] [echo-1]: process details: cmd='echo a', cwd='None'" in shown


def test_signals_reach_the_whole_group(launch, program):
    path = program("""\
        import signal, subprocess, sys
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        child = subprocess.Popen([sys.executable, '-S', '-c',
            "import signal, sys, time; signal.signal(signal.SIGINT, lambda *_: sys.exit('child got it'));"
            "print('ready', flush=True); [time.sleep(0.01) for _ in range(6000)]"])
        child.wait()
        """)
    _, shown, _ = launch(f'- executable: {{cmd: {path}, output: screen}}\n', {'] ready': stop})
    assert '[program-1] child got it' in shown


@pytest.mark.parametrize('prefix', ['', ', launch-prefix: nice -n 1'])
def test_a_node_of_ours_that_is_asked_to_end_at_once_ends_cleanly(launch, prefix):
    """Python itself takes SIGINT long before a line of the program runs, and answers with a traceback."""
    actions = f'- node: {{pkg: tactile_nodes, exec: recorder_node, output: screen{prefix}}}\n'
    source = str(Path(paths.__file__).parent.parent)
    status, shown, _ = launch(
        actions,
        {'process started with pid': stop},
        environment={'PYTHONPATH': source},
        arguments={'sigterm_timeout': '60'},  # on a busy machine it may take longer than usual to become itself
    )
    assert status == 0
    assert 'process has finished cleanly' in shown[-1]
    assert 'Traceback' not in ' '.join(shown)


@pytest.mark.parametrize('options', ['', ', launch-prefix: env'])
def test_other_programs_and_prefixes_have_their_signals_from_the_start(launch, program, options):
    path = program('import signal; print("blocked:", *signal.pthread_sigmask(signal.SIG_BLOCK, []))')
    _, shown, _ = launch(f'- node: {{exec: {path}, output: screen{options}}}\n')
    assert any(line.endswith('blocked:') for line in shown)
