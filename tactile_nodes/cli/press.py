"""``tactile press``: a person presses with a ball and a scale, and is told where, how hard, and what is missing."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.session import positive_float, positive_int

if TYPE_CHECKING:
    from tactile_nodes.learning.guided.guide import Person, Picture
    from tactile_nodes.learning.guided.targets import Done, Target
    from tactile_nodes.sensors import Sensor

DESCRIPTION = (
    'Guide a person who presses by hand, the sensor lying on a scale: where and how hard next, in the terminal and in '
    'FOLDER/next.png; a press held still is taken, its reading is asked for, and both are kept at once. Started again, '
    'it goes on. No ROS is needed, and no node may use the camera meanwhile.'
)
EPILOG = """\
examples:
  tactile press by_hand --source /dev/video0 --sensor mine.yaml --indenter ball:5
  tactile press by_hand --source /dev/video0 --sensor mine.yaml --presses 400     # for a model of its own
  tactile press tried                                                             # a simulated hand, to see how it goes
  tactile calibrate --pictures by_hand/presses.csv --model portable --gel gel-7 -o gel-7.safetensors
  tactile dataset import by_hand/presses.csv -o presses.npz --gel gel-7
"""
UNITS = {'g': 'g', 'kg': 'kg', 'N': 'n', 'mN': 'mn'}
PASSED, UNKNOWN = 's', '?'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='where pictures and presses.csv are kept')
    parser.add_argument(
        '--source', default='simulated', help='a camera as `source:=` of a launch takes it (default: simulated)'
    )
    parser.add_argument(
        '--sensor', default='simulated', metavar='YAML', help='description of the sensor, or the name of one that ships'
    )
    parser.add_argument('--indenter', default='', metavar='NAME', help='what presses, as ball:5 (radius in mm)')
    parser.add_argument(
        '--forces', nargs='+', type=positive_float, default=[20.0, 50.0, 80.0], metavar='FORCE',
        help='forces to press with, about, in the unit of the scale (default: 20 50 80)',
    )  # fmt: skip
    parser.add_argument('--unit', choices=list(UNITS), default='g', help='of the scale (default: g)')
    parser.add_argument(
        '--presses', type=positive_int, default=30, metavar='N',
        help='how many are enough: 30 calibrate, 400 train a model of its own (default: 30)',
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Guide the person to the last press, or until Ctrl-C."""
    from contextlib import closing

    from tactile_nodes.clock import SystemClock
    from tactile_nodes.drivers.camera.contract import SIMULATED, CameraSettings, SceneSettings
    from tactile_nodes.drivers.camera.opening import open_camera
    from tactile_nodes.learning.guided.folder import PressFolder
    from tactile_nodes.learning.guided.guide import Guide, until_enough
    from tactile_nodes.learning.guided.simulated import SimulatedPerson
    from tactile_nodes.learning.guided.targets import Wish
    from tactile_nodes.learning.tables.columns import NEWTONS
    from tactile_nodes.sensors import load_sensor

    sensor, unit = load_sensor(arguments.sensor), UNITS[arguments.unit]
    gel = sensor.gel
    folder = PressFolder(arguments.folder, unit, arguments.indenter, (gel.width_mm / 2, gel.height_mm / 2))
    wish = Wish(arguments.presses, tuple(each * NEWTONS[unit] for each in arguments.forces), gel.outline)
    simulated = arguments.source == SIMULATED
    person: Person = TerminalPerson(arguments.folder, sensor, arguments.unit, NEWTONS[unit])
    scene = SceneSettings()
    if simulated:
        print('a simulated hand presses; with a camera, give --source')
        person, scene = SimulatedPerson(sensor, NEWTONS[unit], print), SceneSettings(world='by hand')
    settings = CameraSettings(source=arguments.source, sensor=arguments.sensor, scene=scene)
    with closing(open_camera(settings, SystemClock(), print)) as camera:
        until_enough(Guide(camera, person, folder, wish, sensor), print)
    print('enough. What to do with them:')
    model = 'portable' if arguments.sensor == 'simulated' else 'ITS_MODEL'
    print(f'  tactile calibrate --pictures {folder.table} --model {model} --gel NAME -o NAME.safetensors')
    print(f'  tactile dataset import {folder.table} -o NAME.npz --gel NAME')
    return 0


class TerminalPerson:
    """Who sits at the terminal."""

    def __init__(self, folder: Path, sensor: Sensor, unit: str, newton: float) -> None:
        self._folder, self._sensor, self._unit, self._newton = folder, sensor, unit, newton
        self._shown = ''

    def leave_untouched(self) -> None:
        print('leave the gel untouched …')

    def press(self, target: Target, picture: Picture, done: list[Done]) -> None:
        from tactile_nodes.drivers.camera.pictures import write_png
        from tactile_nodes.learning.guided.drawing import marked, sketch

        sides_mm = self._sensor.gel.width_mm, self._sensor.gel.height_mm
        drawn = write_png(self._folder / 'next.png', marked(picture, self._sensor, target, done))
        print('\n'.join(sketch(sides_mm, target, done)))
        print(
            f'press at x {target.x_mm:g} mm, y {target.y_mm:g} mm (X, and the cross in {drawn}) with about '
            f'{target.force_n / self._newton:.3g} {self._unit}, and hold it'
        )

    def sees(self, state: str, place_mm: tuple[float, float]) -> None:
        where = (
            ''
            if state == 'untouched' or math.isnan(place_mm[0])
            else f', about x {place_mm[0]:.0f}, y {place_mm[1]:.0f} mm'
        )
        if (line := f'{state}{where}') != self._shown:
            print(f'\r{line:40}', end='', flush=True)
            self._shown = line

    def reading(self, target: Target) -> tuple[float, tuple[float, float]] | None:
        question = (
            f'\nsteady. Hold on: what does the scale show [{self._unit}]? (Behind it x and y in mm, if not at the '
            f'mark, or {UNKNOWN} if you do not know; {PASSED} passes this press over): '
        )
        while True:
            try:
                told = read_answer(input(question), (target.x_mm, target.y_mm))
            except EOFError:  # Ctrl-D ends it as Ctrl-C does
                raise KeyboardInterrupt from None
            if not isinstance(told, str):
                return told
            question = f'{told}: '

    def say(self, text: str) -> None:
        print(text)
        self._shown = ''


def read_answer(text: str, target_mm: tuple[float, float]) -> tuple[float, tuple[float, float]] | str | None:
    """The reading and the place of '50', '50 3.5 -2' or '50 ?'; None of 's'; what is wrong with another answer."""
    words = text.replace(',', '.').split()
    if words == [PASSED]:
        return None
    try:
        numbers = [float(each) for each in words if each != UNKNOWN]
    except ValueError:
        numbers = []
    unknown = words[1:] == [UNKNOWN]
    if len(numbers) not in (1, 3) or len(numbers) != len(words) - unknown or not all(map(math.isfinite, numbers)):
        return 'write the reading alone, as 50, or with a place, as 50 3.5 -2, or as 50 ?'
    if numbers[0] <= 0:
        return 'the reading must be above 0; tare the scale with the sensor on it'
    if unknown:
        return numbers[0], (math.nan, math.nan)
    return numbers[0], (numbers[1], numbers[2]) if len(numbers) == 3 else target_mm
