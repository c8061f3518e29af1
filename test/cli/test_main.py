"""The one command: its help, its exit statuses, and what it does not import."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_nodes import __version__
from tactile_nodes.cli import main as command
from tactile_nodes.cli.main import VERBS, chosen_verb, make_parser, parse

ROOT = Path(__file__).parents[2]


def _python(code: str) -> str:
    found = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, cwd=ROOT, check=True)
    return found.stdout


def test_help_names_every_verb_and_imports_nothing_heavy() -> None:
    code = (
        'import sys\nfrom tactile_nodes.cli.main import main\n'
        'try:\n    main(["--help"])\nexcept SystemExit:\n    pass\n'
        'import json; print(json.dumps(sorted(sys.modules)))'
    )
    *text, modules = _python(code).splitlines()
    assert all(any(line.strip().startswith(verb) for line in text) for verb in VERBS)
    assert not {'numpy', 'cv2', 'zmq', 'rosbags', 'torch', 'rich', 'yaml'} & set(json.loads(modules))


@pytest.mark.parametrize('verb', VERBS)
def test_each_verb_has_a_module_with_arguments_and_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        make_parser(verb).parse_args([verb, '--help'])
    assert ended.value.code == 0
    assert f'usage: tactile {verb}' in capsys.readouterr().out


def test_a_verb_is_found_behind_flags() -> None:
    assert chosen_verb(['--version', 'topic', 'list']) == 'topic'
    assert chosen_verb(['nonsense']) is None


def test_without_a_verb_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([]) == 0
    assert 'first steps' in capsys.readouterr().out


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(['--version'])
    assert capsys.readouterr().out == f'tactile_nodes {__version__}\n'


def test_an_unknown_verb_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        command.main(['topics'])
    assert ended.value.code == 2
    assert 'topics' in capsys.readouterr().err


def test_an_error_of_ours_is_one_line_and_status_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    assert command.main(['topic', 'list']) == 1
    printed = capsys.readouterr()
    assert printed.out == ''
    assert printed.err == "ROS_DOMAIN_ID is 'seven'; set it to a number from 0 to 232\n"


def test_ctrl_c_is_quiet_and_status_130(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr('tactile_nodes.cli.completion.run', interrupted)
    assert command.main(['completion', 'bash']) == 130
    assert capsys.readouterr() == ('', '')


def test_a_reader_that_leaves_ends_the_command_quietly() -> None:
    code = 'import sys; from tactile_nodes.cli.main import main; sys.exit(main(["completion", "bash"]))'
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b''
        assert process.wait() == 141


def test_flags_may_stand_between_the_other_words() -> None:
    words = ['launch', 'live', '--view', 'source:=/dev/video0', '-d', 'model:=paper']
    arguments = parse(make_parser('launch'), 'launch', words)
    assert arguments.words == ['live', 'source:=/dev/video0', 'model:=paper']
    assert arguments.view
    assert arguments.debug
