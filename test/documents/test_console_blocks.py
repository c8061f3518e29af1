"""The commands of README and the how-to pages do what they say, run as a reader would: one after another, in a folder.

What takes minutes is run by `make documents` only; what needs another machine, a device or ROS 2 is only parsed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
from blocks import ROOT, blocks, commands

sys.path.insert(0, str(ROOT / 'test'))
sys.path.insert(0, str(ROOT / 'test/cli'))
from body_presses import BodySensor
from press_bags import OTHER, Sensor, spread_collection
from test_calibrate import pressed, recorded

from tactile_nodes.cli.main import main
from tactile_nodes.learning.datasets.file import save_dataset
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.simulation.optics import Press

ELSEWHERE = re.compile(
    r'/dev/|rig:=real|my_rig|\bros2\b|rviz2|colcon|rosdep|/opt/ros|camera\.local|192\.168|0\.0\.0\.0|SUBNET|/robot/'
    r'|^(pip|make|ruff|source|cd|mkdir|export) |\bdask\b|\bssh\b|python -m pytest'
    r'|TACTILE_ROS|NAME-OF|gel:=NAME|/data/|venv|camera_0|mini_example'
    r'|^tactile reference$|train run\.yaml|tcp://HOST'
)
"""Devices, other machines, ROS 2, recordings of others, code that the reader writes, and what prepares or changes a
checkout: CI runs `make test` itself."""

MINUTES = re.compile(
    r'tactile (launch|bench|tune|compile|calibrate|export|model export|reference|press by_hand)|tactile train config'
    r'|tactile evaluate (?!gel-7|my_gel)|--profile|--model paper|bag_to_figure|bag_with|--duration'
    r'|force_views_node|touch_views|gels add'
)
"""What renders, trains, measures or draws for long, runs until somebody ends it, or needs what such a command makes."""

ON_PRESSES = re.compile(r'train --dataset|evaluate .*--dataset')
"""What learns from more presses than the reader's folder has, or judges what was learned."""

WITH_A_RIG = re.compile(
    r'(?<!:=)/rig/|/emulated_rig|/calibrator/|sync_input|undo_calibration|--compare|bag sync|sync_edge|both_fingers'
)
"""What asks a node that the live launch does not start, or for what minutes with a rig make (test/cli tries what a bag
of a rig becomes, test/nodes that of a hand)."""

OF_A_RIG = re.compile(r'/rig/(pause|resume|stop|acknowledge)|/emulated_rig')
"""Of these what is asked of a rig, which `make documents` starts."""

UNTIL_ENDED = re.compile(
    r'topic (echo(?!.*--once)|delay|hz|bw)|bag record(?!.*--duration)|topic pub|(?<!info -v /)force_distribution$'
    r'|grip.py|tactile launch|force_views_node'
)
ASKING = re.compile(r'tactile (bag|topic|param|service)|grip.py|force_distribution$|press1|\btouch\b')
"""What asks a live launch, or a bag of one."""
TELLS = re.compile(r'topic (echo|delay|hz|bw)|(?<!info -v /)force_distribution$')
"""Those of them whose first line on the standard output shows that they work."""
HERE = re.compile(r'tactile [^|<>;&]*$')
"""A command of ours alone, without a pipe, a redirection or another command."""
PLACES = {'pen_01': (-8.0, 3.0), 'pen_02': (8.0, 4.0), 'pen_03': (0.0, -9.0)}
LONG = bool(os.environ.get('TACTILE_LONG'))
RECORDED_S = 12 if LONG else 1
"""Only figures that `make documents` draws need a whole press in it. It is also played, once at half its rate."""
NAMED = re.compile(
    r'\b((run1|press1|press1_again|replayed|touch|robot|lab|collected_\d)\b ?|(collection|gel_7)[^ ]* ?)+'
)
"""Bags, keys and folders, which a reader names. Of commands that differ in nothing else one is run."""


def page_commands() -> list[str]:
    """All commands of the pages, in their order."""
    shells = [each for each in blocks() if each.language in {'sh', 'console'} and 'results' not in each.file.parts]
    return list(dict.fromkeys(command for each in shells for command in commands(each)))


def chosen() -> list[str]:
    skipped = [ELSEWHERE, WITH_A_RIG, ON_PRESSES] + ([] if LONG else [MINUTES])
    kept = [command for command in page_commands() if not any(each.search(command) for each in skipped)]
    return kept if LONG else list({NAMED.sub('', command): command for command in reversed(kept)}.values())[::-1]


def groups() -> list[tuple[str, ...]]:
    """Each command alone, but those that ask a live launch together and last: else each worker would start one."""
    if LONG:
        return [(command,) for command in chosen()]
    asking = tuple(command for command in chosen() if ASKING.search(command))
    return [*((command,) for command in chosen() if command not in asking), asking]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A reader's folder: what earlier commands of the pages have made, under the names that they give it."""
    made = tmp_path_factory.mktemp('reader')
    for name in ('config', 'examples', 'constraints.txt', 'docs'):
        (made / name).symlink_to(ROOT / name)
    number = 48 if LONG else 6  # the paper's layer asks for 40
    presses = spread_collection(made / 'collected_1', Sensor(OTHER), number)
    for name in ('collected', 'collected_2', 'new_gel_bag', 'collection/rosbag2_a', 'gel_7/rosbag2_a'):
        (made / name).parent.mkdir(exist_ok=True)
        shutil.copytree(presses, made / name)
    (made / 'by_hand').mkdir()
    (made / 'my_points.yaml').symlink_to(ROOT / 'config/plans/coarse.yaml')
    (made / 'my.yaml').symlink_to(ROOT / 'config/live.yaml')
    (made / 'my_hand.yaml').symlink_to(ROOT / 'config/hands/two_fingers.yaml')
    (made / 'description.yaml').symlink_to(ROOT / 'config/sensors/simulated.yaml')
    shutil.copy(ROOT / 'models/portable.safetensors', made / 'gel-7.safetensors')
    (made / 'gel-7.csv').write_text(next(each.text for each in blocks() if each.language == 'csv'))
    sensor = Sensor(OTHER)
    for name in re.findall(r'^(\w+)\.png', (made / 'gel-7.csv').read_text(), re.MULTILINE):
        presses = () if name.startswith('rest') else (Press(*PLACES.get(name, (2.0, 1.0)), 0.6),)
        cv2.imwrite(str(made / f'{name}.png'), sensor.image(*presses))
    cv2.imwrite(str(made / 'rest.png'), sensor.image())
    write_presses(made, sensor)
    return made


def write_presses(made: Path, sensor: Sensor) -> None:
    """A picture untouched and two presses, in tables with the names that readers give them, as videos and a folder."""
    pressed = [Press(2.0, 1.0, 0.6), Press(-4.0, 3.0, 1.0)]
    rows = [',,0', *(f'{each.x_mm},{each.y_mm},{sensor.force_n(each.depth_mm):.3f}' for each in pressed)]
    kinds = {'video.mp4': 'mp4v', 'recording.avi': 'MJPG'}
    videos = [
        cv2.VideoWriter(str(made / name), cv2.VideoWriter_fourcc(*kind), 10.0, (440, 440), False)
        for name, kind in kinds.items()
    ]
    (made / 'pictures').mkdir()
    for number, touch in enumerate([[], *([each] for each in pressed)]):
        picture = sensor.image(*touch)
        cv2.imwrite(str(made / f'hand_{number}.png'), picture)
        cv2.imwrite(str(made / f'pictures/{number:03}.png'), picture)
        for video in videos:
            video.write(picture)
    for video in videos:
        video.release()
    columns = 'x_mm,y_mm,force_n'
    for name in ('presses', 'ball', 'punch'):
        lines = [f'picture,{columns}', *(f'hand_{number}.png,{row}' for number, row in enumerate(rows))]
        (made / f'{name}.csv').write_text('\n'.join(lines) + '\n')
    lines = [f'time_s,{columns}', *(f'{number / 10},{row}' for number, row in enumerate(rows))]
    (made / 'times.csv').write_text('\n'.join(lines) + '\n')


@pytest.fixture(scope='module')
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    run = tmp_path_factory.mktemp('r')
    run.chmod(0o700)
    path = f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'
    own = {'TACTILE_RUN_DIR': str(run), 'ROS_LOG_DIR': str(run / 'log'), 'XDG_CONFIG_HOME': str(run), 'PATH': path}
    return {**os.environ, **own, 'ROS_DOMAIN_ID': '23', 'MPLBACKEND': 'agg', 'PYTHONPATH': str(ROOT)}


@pytest.fixture(scope='module')
def live(folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """`tactile launch live`, and a bag of it under each name that the pages give to one.

    At a twelfth of its rate, since it takes the processor from the commands for as long as they run. Between two
    presses seven frames come then, too few for a rest image where the nodes have missed the first.
    """
    words = [
        'tactile',
        'launch',
        'live',
        'page:=false',
        'model:=portable',
        'compiled:=false',
        'fps:=5',
        'reference_frames:=4',
    ]
    with subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            said: list[str] = []
            for line in process.stdout:
                said.append(line)
                if 'new rest image' in line:
                    break
            threading.Thread(target=said.extend, args=(process.stdout,), daemon=True).start()  # it never waits for us
            run_here('tactile topic echo /force_distribution --once', folder, environment)
            run_here('tactile bag record -o press1 --duration 1', folder, environment)
            for name in ('run1', 'press1_again', 'replayed', 'grasp1', 'grasp2', 'touch'):
                shutil.copytree(folder / 'press1', folder / name)
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)
            assert process.returncode == 0


def prepare(command: str, folder: Path, environment: dict[str, str]) -> None:
    """What a reader would do before: give a recording a name that is free, or replay one before comparing it.

    A data set that an earlier command makes is made, since another worker may have run that command.
    """
    for name in re.findall(r'\w+\.npz', command):
        if f'-o {name}' not in command and not (folder / name).exists():
            earlier = next(each for each in chosen() if f'-o {name}' in each)
            run_here(earlier, folder, environment)
    if 'by_hand/presses.csv' in command and not (folder / 'by_hand/presses.csv').exists():  # by a simulated hand
        run_here('tactile press by_hand --sensor mine.yaml --indenter ball:5', folder, environment)
    if 'punch_bag' in command and not (folder / 'punch_bag').exists():
        sensor = BodySensor('punch:1.5', 2.0)
        spread_collection(folder / 'punch_bag', sensor, 20, 9.5, (0.1, float(sensor.touched.depth_mm[-1])))
    if match := re.search(r'bag record -o (\w+)', command):
        shutil.rmtree(folder / match[1], ignore_errors=True)
    if 'launch replay' in command:
        shutil.rmtree(folder / 'replayed', ignore_errors=True)
    if match := re.search(r'bag compare (\w+) (\w+)', command):
        shutil.rmtree(folder / match[2], ignore_errors=True)
        shutil.copytree(folder / match[1], folder / match[2])


def asked_of_a_rig() -> list[str]:
    """What a reader asks of a rig in the midst of a run, its end last."""
    found = [command for command in page_commands() if OF_A_RIG.search(command)]
    return sorted(found, key=lambda command: ('/stop' in command, command))


@pytest.mark.skipif(not LONG, reason='starts an emulated rig: make documents')
def test_what_the_documents_ask_of_a_rig_is_done(folder: Path, environment: dict[str, str]) -> None:
    environment = {**environment, 'ROS_DOMAIN_ID': '25'}
    words = ['tactile', 'launch', 'collect', 'rig:=emulated', 'plan:=coarse', 'folder:=asked']
    with subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as rig:
        try:
            assert rig.stdout is not None
            assert any('searching for the surface' in line for line in rig.stdout)
            for command in asked_of_a_rig():
                asked = ['bash', '-c', command]
                said = subprocess.run(asked, cwd=folder, env=environment, check=False, capture_output=True, timeout=60)
                assert said.returncode == 0, (command, said.stderr.decode())
                assert b'success=False' not in said.stdout, (command, said.stdout.decode())
        finally:
            rig.send_signal(signal.SIGINT)
            rig.communicate(timeout=60)


@pytest.mark.timeout(600)
def test_what_the_documents_learn_from_presses_is_learned(tmp_path: Path, environment: dict[str, str]) -> None:
    save_dataset(tmp_path / 'presses.npz', many_presses())
    learning = [command for command in page_commands() if ON_PRESSES.search(command)]
    under_one_name = (each.replace('my_gel', 'gel-7').replace('gel_7.npz', 'presses.npz') for each in learning)
    commands = list(dict.fromkeys(under_one_name))
    for command in commands:
        if not any(other.startswith(f'{command} ') for other in commands):  # which does the same and more
            run(command, tmp_path, environment)


def many_presses() -> RecordedPresses:
    """Of 200 samples one in seven is the untouched gel; of a gel that moves in proportion to the force."""
    made = recorded(pressed(200, 2, 1.0, 0.0), 'mine')
    methods = {'flow': make_flow('dis', {}), 'encoding': make_encoding('cartesian_mean', {'rows': 6, 'cols': 6})}
    described = {what: {'name': each.name, 'options': each.options} for what, each in methods.items()}
    return dataclasses.replace(made, card={**made.card, **described})


@pytest.mark.timeout(3600 if LONG else 180)
@pytest.mark.parametrize('together', groups(), ids=lambda together: together[0])
def test_commands_of_the_documents_run(
    together: tuple[str, ...], folder: Path, environment: dict[str, str], request: pytest.FixtureRequest
) -> None:
    if 'pandas' in together[0]:
        pytest.importorskip('pandas')
    if LONG or ASKING.search(together[0]):
        request.getfixturevalue('live')
    for command in together:
        run(command, folder, environment)


def run(command: str, folder: Path, environment: dict[str, str]) -> None:
    """As a reader would; what it says must hold no traceback."""
    command = command.removesuffix(' &').replace('…', 'a')
    prepare(command, folder, environment)
    if re.search('tactile (launch|bag play)', command):  # a reader would have ended the one before: pictures of both
        environment = {**environment, 'ROS_DOMAIN_ID': '24'}
    if HERE.match(command) and (TELLS.search(command) or not UNTIL_ENDED.search(command)):
        return run_here(command, folder, environment)
    around: dict[str, Any] = {'cwd': folder, 'env': environment, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}
    if UNTIL_ENDED.search(command):
        ended = run_until_ended(command, around)
    else:
        ended = subprocess.run(['bash', '-c', command], check=False, timeout=900, **around)
    said = f'{ended.stdout[-3000:].decode()}{ended.stderr.decode()}'
    right = {0, 130} if UNTIL_ENDED.search(command) else {0}
    assert ended.returncode in right, f'{command}: exit status {ended.returncode}: {said}'
    assert b'Traceback' not in ended.stderr, f'{command}: {said}'
    return None


def run_here(command: str, folder: Path, environment: dict[str, str]) -> None:
    """In this process, with the words that a shell makes of the command: no process has to import the package."""
    expanded = subprocess.run(
        ['bash', '-c', command.replace('tactile', "printf '%s\\0'", 1)],
        cwd=folder, env=environment, check=True, capture_output=True, text=True,
    )  # fmt: skip
    words = expanded.stdout.rstrip('\0').split('\0')
    ended = UNTIL_ENDED.search(command) is not None
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(io.StringIO()) as wrong:
        patch.chdir(folder)
        for name, value in environment.items():
            patch.setenv(name, value)
        with contextlib.redirect_stdout(EndedByFirstLine()) if ended else contextlib.nullcontext():
            status = main(words)
    assert status in ({0, 130} if ended else {0}), f'{command}: exit status {status}: {wrong.getvalue()}'
    assert 'Traceback' not in wrong.getvalue(), f'{command}: {wrong.getvalue()}'


class EndedByFirstLine(io.StringIO):
    """A terminal at which somebody presses Ctrl-C once a line is there."""

    def write(self, text: str) -> int:
        ended, written = '\n' in self.getvalue(), super().write(text)
        if '\n' in text and not ended:
            signal.raise_signal(signal.SIGINT)
        return written


def run_until_ended(command: str, around: dict[str, Any]) -> subprocess.CompletedProcess[bytes]:
    """Ctrl-C ends it after its first line, a while after a recording has begun; a launch ends after its time."""
    records = 'bag record' in command
    into = Path(around['cwd'], command.rpartition(' > ')[2]) if ' > ' in command else None
    if into is not None:
        into.unlink(missing_ok=True)  # of another command, or of a try before
    longest_s = 30 if 'tactile launch' in command else 60
    words = ['bash', '-c', f'exec timeout --signal=INT --preserve-status {longest_s} {command}']
    with subprocess.Popen(words, bufsize=0, **around) as process:
        begun = b''
        assert process.stdout is not None and process.stderr is not None
        if into is not None:
            while process.poll() is None and not (into.exists() and into.stat().st_size):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(0.05)
            process.send_signal(signal.SIGINT)
        elif 'tactile launch' not in command and not records:
            select.select([process.stdout, process.stderr], [], [])
            process.send_signal(signal.SIGINT)
        elif records:
            begun = process.stderr.readline()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(RECORDED_S)
            process.send_signal(signal.SIGINT)
        said, wrong = process.communicate(timeout=900)
    return subprocess.CompletedProcess(words, process.returncode, said, begun + wrong)
