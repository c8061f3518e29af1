"""What the shell is offered when Tab is pressed."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import argcomplete
import pytest
from running_system import LampNode, Tactile

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.cli.main import main

ROOT = Path(__file__).parents[2]


Offered = Callable[[str], set[str]]


def asking(line: str) -> dict[str, str]:
    """What bash adds to the environment of a command whose line it asks it to complete."""
    return {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n', 'COMP_LINE': line, 'COMP_POINT': str(len(line))}


def offers(written: str) -> set[str]:
    return {word.strip() for word in written.splitlines() if word.strip()}


class Silent(argcomplete.CompletionFinder):
    """Writes nothing into file 9, which is another one in the process of a test."""

    def _init_debug_stream(self) -> None:
        """There is no debug output."""


@pytest.fixture
def offered(run_folder: Path, capfd: pytest.CaptureFixture[str]) -> Offered:
    """The offers for a line, made in this process, which argcomplete would end."""

    def complete(line: str) -> set[str]:
        written = io.StringIO()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(argcomplete, 'autocomplete', partial(Silent(), exit_method=sys.exit, output_stream=written))
            for name, value in asking(line).items():
                patch.setenv(name, value)
            with pytest.raises(SystemExit) as ended:
                main([])
        assert ended.value.code == 0
        assert capfd.readouterr() == ('', '')
        return offers(written.getvalue())

    return complete


def test_a_shell_gets_its_offers_from_a_process_that_says_nothing(tmp_path: Path) -> None:
    answer = tmp_path / 'offered'
    words = [sys.executable, '-c', 'from tactile_nodes.cli.main import main; main()']
    environment = {**os.environ, **asking('tactile to'), '_ARGCOMPLETE_STDOUT_FILENAME': str(answer)}
    ended = subprocess.run(words, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, '', '')
    assert offers(answer.read_text()) == {'topic'}


def test_commands_of_a_verb_and_flags_are_offered(offered: Offered) -> None:
    assert offered('tactile topic e') == {'echo'}
    assert offered('tactile topic echo --on') == {'--once'}


def test_topics_that_exist_now_are_offered(other: ZmqBus, offered: Offered) -> None:
    other.advertise('/skin/image_raw', 'sensor_msgs/msg/Image', Qos())
    other.advertise('/skin/wrench', 'geometry_msgs/msg/WrenchStamped', Qos())
    assert offered('tactile topic hz /skin/w') == {'/skin/wrench'}
    assert offered('tactile topic hz skin/i') == {'skin/image_raw'}


def test_the_type_of_the_topic_is_offered(other: ZmqBus, offered: Offered) -> None:
    other.advertise('/w', 'geometry_msgs/msg/WrenchStamped', Qos())
    assert offered('tactile topic pub /w ') >= {'geometry_msgs/msg/WrenchStamped'}


def test_nodes_services_and_parameters_are_offered(lamp: LampNode, offered: Offered) -> None:
    assert offered('tactile node info /l') == {'/lamp'}
    assert offered('tactile service call /lamp/b') == {'/lamp/blink'}
    assert offered('tactile param get /lamp l') == {'level'}


def test_a_bus_that_cannot_be_joined_is_no_reason_to_speak(offered: Offered, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    assert offered('tactile topic echo /') == set()


def test_launch_files_are_offered(offered: Offered) -> None:
    assert 'live' in offered('tactile launch li')


@pytest.mark.parametrize(('shell', 'word'), [('bash', 'complete '), ('zsh', 'compdef'), ('fish', 'complete --command')])
def test_what_to_source_is_printed(shell: str, word: str, tactile: Tactile) -> None:
    ended = tactile('completion', shell)
    assert ended.status == 0
    assert word in ended.out
    assert 'tactile' in ended.out
