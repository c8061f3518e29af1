"""What the shell is offered when Tab is pressed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from running_system import LampNode, Tactile

from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus

ROOT = Path(__file__).parents[2]


@pytest.fixture
def offered(run_folder: Path, tmp_path: Path) -> object:
    """Completes a line as bash would; the offers, or '' where there are none."""

    def complete(line: str) -> set[str]:
        answer = tmp_path / 'offered'
        answer.unlink(missing_ok=True)
        answer.touch()
        environment = {
            **os.environ,
            '_ARGCOMPLETE': '1',
            '_ARGCOMPLETE_IFS': '\n',
            '_ARGCOMPLETE_STDOUT_FILENAME': str(answer),
            'COMP_LINE': line,
            'COMP_POINT': str(len(line)),
        }
        words = [sys.executable, '-c', 'from tactile_nodes.cli.main import main; main()']
        ended = subprocess.run(words, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
        assert (ended.stdout, ended.stderr) == ('', '')
        return {word.strip() for word in answer.read_text().splitlines() if word.strip()}

    return complete


def test_verbs_are_offered(offered) -> None:
    assert offered('tactile to') == {'topic'}


def test_commands_of_a_verb_are_offered(offered) -> None:
    assert offered('tactile topic e') == {'echo'}


def test_flags_are_offered(offered) -> None:
    assert offered('tactile topic echo --on') == {'--once'}


def test_topics_that_exist_now_are_offered(other: ZmqBus, offered) -> None:
    other.advertise('/skin/image_raw', 'sensor_msgs/msg/Image', Qos())
    other.advertise('/skin/wrench', 'geometry_msgs/msg/WrenchStamped', Qos())
    assert offered('tactile topic hz /skin/w') == {'/skin/wrench'}
    assert offered('tactile topic hz skin/i') == {'skin/image_raw'}


def test_the_type_of_the_topic_is_offered(other: ZmqBus, offered) -> None:
    other.advertise('/w', 'geometry_msgs/msg/WrenchStamped', Qos())
    assert offered('tactile topic pub /w ') >= {'geometry_msgs/msg/WrenchStamped'}


def test_nodes_services_and_parameters_are_offered(lamp: LampNode, offered) -> None:
    assert offered('tactile node info /l') == {'/lamp'}
    assert offered('tactile service call /lamp/b') == {'/lamp/blink'}
    assert offered('tactile param get /lamp l') == {'level'}


def test_a_bus_that_cannot_be_joined_is_no_reason_to_speak(offered, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    assert offered('tactile topic echo /') == set()


def test_launch_files_are_offered(offered) -> None:
    assert 'live' in offered('tactile launch li')


@pytest.mark.parametrize(('shell', 'word'), [('bash', 'complete '), ('zsh', 'compdef'), ('fish', 'complete --command')])
def test_what_to_source_is_printed(shell: str, word: str, tactile: Tactile) -> None:
    ended = tactile('completion', shell)
    assert ended.status == 0
    assert word in ended.out
    assert 'tactile' in ended.out
