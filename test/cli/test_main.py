"""The one command: its help, its exit statuses, and what it does not import."""

from __future__ import annotations

import errno
import importlib
import json
import os
import re
import shlex
import shutil
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


@pytest.mark.parametrize('verb', ['camera', 'export', 'gels', 'keys', 'model', 'topic'])
def test_each_subcommand_says_what_it_does_and_shows_its_own_examples_only(verb: str) -> None:
    (subcommands,) = make_parser(verb)._subparsers._group_actions[0].choices[verb]._subparsers._group_actions
    for name, parser in subcommands.choices.items():
        assert parser.description
        shown = [line.strip() for line in (parser.epilog or '').splitlines() if line.strip().startswith('tactile ')]
        assert all(line.startswith(f'tactile {verb} {name}') for line in shown)


def examples() -> list[str]:
    """The commands in the help texts, without the remarks behind them."""
    texts = (getattr(importlib.import_module(f'tactile_nodes.cli.{verb}'), 'EPILOG', '') for verb in VERBS)
    lines = (line.strip() for text in texts for line in text.splitlines())
    found = (re.split(r'  |# |&& | > | \| ', line)[0] for line in lines if re.match('tactile [a-z]', line))
    return sorted(each for each in set(found) if not each.endswith('--help'))


@pytest.mark.parametrize('example', examples())
def test_an_example_in_a_help_text_is_a_command_that_the_program_takes(example: str) -> None:
    words = shlex.split(example)[1:]
    verb = chosen_verb(words)
    parse(make_parser(verb), verb, words)


def test_a_letter_that_the_terminal_lacks_ends_no_launch(tmp_path: Path) -> None:
    file = tmp_path / 'a.launch.yaml'
    file.write_text('launch:\n- executable: {cmd: echo 0 → 1, output: screen}\n', encoding='utf-8')
    environment = {**os.environ, 'PYTHONIOENCODING': 'latin-1', 'ROS_LOG_DIR': str(tmp_path)}
    words = [sys.executable, '-m', 'tactile_nodes', 'launch', str(file)]
    found = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, env=environment, check=True)
    assert '[echo-1] 0 \\u2192 1' in found.stdout.splitlines()
    assert found.stderr == ''


def test_a_letter_that_the_locale_lacks_ends_no_command() -> None:
    environment = {**os.environ, 'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}
    words = [sys.executable, '-m', 'tactile_nodes', 'launch', 'live', '--show-args']
    found = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, env=environment, check=True)
    assert '(mixed, tip, ring, edge, two, \\u2026, ball:5, a mesh' in found.stdout
    assert found.stderr == ''


def test_a_verb_is_found_behind_flags() -> None:
    assert chosen_verb(['--version', 'topic', 'list']) == 'topic'
    assert chosen_verb(['nonsense']) is None


def test_without_a_verb_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([]) == 0
    assert 'first steps' in capsys.readouterr().out


def test_the_version_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(['--version'])
    assert capsys.readouterr().out == f'tactile_nodes {__version__}\n'


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


@pytest.mark.parametrize('verb', ['completion bash', 'doctor'])
def test_a_reader_that_leaves_ends_the_command_quietly(verb: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    words = [sys.executable, '-m', 'tactile_nodes', *verb.split()]
    found = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    os.close(writing)
    assert (found.returncode, found.stderr) == (141, b'')


def test_a_caller_may_close_standard_input_and_output(tmp_path: Path) -> None:
    (tmp_path / 'a.launch.yaml').write_text('launch:\n- log: {message: hello}\n', encoding='utf-8')
    words = ['sh', '-c', 'exec "$0" -m tactile_nodes launch "$1" <&- >&-', sys.executable, tmp_path / 'a.launch.yaml']
    environment = {**os.environ, 'ROS_LOG_DIR': str(tmp_path)}
    found = subprocess.run(words, stderr=subprocess.PIPE, cwd=ROOT, env=environment, check=False)
    assert (found.returncode, found.stderr) == (0, b'')


def test_flags_may_stand_between_the_other_words() -> None:
    words = ['launch', 'live', '--view', 'source:=/dev/video0', '-d', 'model:=paper']
    arguments = parse(make_parser('launch'), 'launch', words)
    assert arguments.words == ['live', 'source:=/dev/video0', 'model:=paper']
    assert arguments.view
    assert arguments.debug


@pytest.mark.parametrize(
    'words',
    [
        ('model', 'info', 'x' * 300),
        ('model', 'export', 'fast', '-o', 'folder'),
        ('collect', 'x' * 300),
        ('calibrate', 'bag', '--model', 'x' * 300, '-o', 'made'),
        ('calibrate', 'bag', '--model', 'portable', '-o', 'folder'),
        ('dataset', 'build', 'bag', '-o', 'folder'),
        ('train', 'quick', '-o', 'folder'),
        ('train', 'quick', '-o', 'made.onnx'),
        ('calibrate', '--sensor', 'mine.yaml', '--model', 'field', '-o', 'made.onnx'),
        ('evaluate', 'fast', '--json', 'folder'),
        ('export', 'parquet', 'loop'),
        ('export', 'parquet', 'bag', '-o', 'x' * 300),
        ('run', '--prefix', "'gdb -ex run", 'camera_node'),
    ],
    ids=lambda words: ' '.join(words)[:40],
)
def test_a_name_that_cannot_be_is_one_sentence(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('folder').mkdir()
    Path('loop').symlink_to('loop')
    assert command.main(words) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ['folder', 'loop']


@pytest.mark.parametrize(
    'words',
    [
        ('train', '--dataset', 'presses.npz', '-o', 'presses.npz'),
        ('evaluate', 'gel.safetensors', '--dataset', 'presses.npz', '--json', 'presses.npz'),
        ('evaluate', 'gel.safetensors', '--dataset', 'presses.npz', '--picture', 'gel.safetensors'),
        ('model', 'export', 'gel.safetensors', '-o', 'gel.safetensors'),
    ],
)
def test_what_a_command_reads_is_not_written_over(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(shipped := ROOT / 'models' / 'fast.safetensors', 'gel.safetensors')
    Path('presses.npz').touch()
    assert command.main(words) == 1
    assert capsys.readouterr().err == f'cannot write {words[-1]}: {words[-1]} is read for it; choose another file\n'
    assert Path('presses.npz').read_bytes() == b''
    assert Path('gel.safetensors').read_bytes() == shipped.read_bytes()


@pytest.mark.parametrize(
    'words',
    [
        ('topics',),
        ('bag', 'record', '--duration', 'nan'),
        ('bag', 'record', '--duration', '-1'),
        ('bag', 'play', 'bag', '--delay', 'inf'),
        ('evaluate', 'fast', '--seed', '-1'),
        ('train', '--seed', '-1'),
        ('train', '--seed', '9' * 20),
        ('topic', 'hz', 'wrench', '--window', '9' * 30),
        ('topic', 'pub', 'greeting', 'std_msgs/String', '--rate', '1e-320'),
        ('topic', 'pub', 'greeting', 'std_msgs/String', '--keep-alive', 'inf'),
    ],
    ids=' '.join,
)
def test_a_verb_or_number_that_cannot_be_is_a_usage_error(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        command.main(words)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert words[-1] in said
    assert 'is not a ' in said or 'invalid choice' in said


def test_what_the_system_refuses_is_one_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: object) -> int:
        raise OSError(errno.ENOSPC, 'No space left on device', 'scores.json')

    monkeypatch.setattr('tactile_nodes.cli.doctor.run', full)
    assert command.main(['doctor']) == 1
    assert capsys.readouterr().err == (
        "operating system error: 'scores.json': No space left on device; check disk space and permissions\n"
    )
