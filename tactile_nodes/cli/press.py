"""``tactile press``: guide a person who presses with a ball and a scale."""

from __future__ import annotations

import argparse
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running.session import positive_float, positive_int

if TYPE_CHECKING:
    from tactile_nodes.learning.field.body import KnownBody
    from tactile_nodes.learning.guided.guide import Person, Picture
    from tactile_nodes.learning.guided.targets import Target
    from tactile_nodes.sensors import Sensor

DESCRIPTION = (
    'Guide a person who presses by hand while the sensor lies on a scale. The terminal and FOLDER/next.png show where '
    'and how hard to press next. When a press is steady, enter the reading of the scale; picture and reading are saved '
    'at once. Run it again to continue. ROS is not needed, and no node may use the camera meanwhile.'
)
EPILOG = """\
examples:
  tactile press by_hand --source /dev/video0 --sensor mine.yaml --indenter ball:5
  tactile press by_hand --source /dev/video0 --sensor mine.yaml --indenter punch:2   # same folder, another indenter
  tactile press own --source /dev/video0 --sensor mine.yaml --presses 200 --forces 20 50 80  # to train from scratch
  tactile press tried --sensor speckle_membrane --indenter ball:5                      # a simulated hand, to try it out
The commands to calibrate with these presses are printed at the end.
"""
USUAL_G = 20.0, 50.0, 80.0
CALIBRATED = 'calibrated.safetensors'
UNITS = {'g': 'g', 'kg': 'kg', 'N': 'n', 'mN': 'mn'}
PASSED = 's'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='where pictures and presses.csv are kept')
    parser.add_argument(
        '--source', default='simulated', help='a camera, as in `source:=` of a launch (default: simulated)'
    )
    parser.add_argument(
        '--sensor', default='simulated', metavar='YAML', help='description of the sensor, or the name of a shipped one'
    )
    parser.add_argument(
        '--indenter', default='', metavar='NAME',
        help='the indenter, e.g. ball:5 or punch:1.5 (radius in mm), ring, part.stl (simulated: the tip, ball:0.6)',
    )  # fmt: skip
    parser.add_argument(
        '--forces', nargs='+', type=positive_float, default=[], metavar='FORCE',
        help='approximate forces to press with, in the unit of the scale (default: in the linear range of the gel)',
    )  # fmt: skip
    parser.add_argument('--unit', choices=list(UNITS), default='g', help='unit of the scale (default: g)')
    parser.add_argument(
        '--presses', type=positive_int, default=30, metavar='N',
        help='number of presses with this indenter: 30 to calibrate (5 at least), 200 to train a model from scratch '
        '(default: 30)',
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Guide the person until the last press or Ctrl-C."""
    from contextlib import closing

    from tactile_nodes.clock import SystemClock
    from tactile_nodes.drivers.camera.contract import SIMULATED, CameraSettings, SceneSettings
    from tactile_nodes.drivers.camera.opening import open_camera
    from tactile_nodes.learning.guided.folder import PressFolder
    from tactile_nodes.learning.guided.guide import Guide
    from tactile_nodes.learning.guided.simulated import TIP, SimulatedPerson
    from tactile_nodes.learning.guided.targets import Wish
    from tactile_nodes.learning.tables.columns import NEWTONS
    from tactile_nodes.learning.transfer.checks import LEAST_PRESSES
    from tactile_nodes.sensing.geometry import BinGrid
    from tactile_nodes.sensors import load_sensor

    sensor, unit = load_sensor(arguments.sensor), UNITS[arguments.unit]
    simulated = arguments.source == SIMULATED
    indenter = arguments.indenter or (TIP if simulated else '')
    folder = PressFolder(arguments.folder, arguments.unit, indenter, BinGrid.of_sensor(sensor).reach_mm)
    if folder.left_out:
        print(folder.left_out)
    body = _body(indenter)
    forces_n = _forces_n(sensor, body, arguments.forces, arguments.unit)
    wish = Wish(arguments.presses, forces_n, sensor)
    person: Person = TerminalPerson(arguments.folder, sensor, arguments.unit, NEWTONS[unit])
    scene = SceneSettings()
    if simulated:
        print(f'a simulated hand presses with {indenter}; give --source to use a camera')
        person = SimulatedPerson(sensor, NEWTONS[unit], print, body=body or _known(indenter))
        scene = SceneSettings(world='by hand')
    settings = CameraSettings(source=arguments.source, sensor=arguments.sensor, scene=scene)
    with closing(open_camera(settings, SystemClock(), print)) as camera:
        guide = Guide(camera, person, folder, wish, sensor)
        try:
            guide.run()
        finally:
            person.say(guide.missing())
    if (count := sum(row.touches for row in folder.rows)) < LEAST_PRESSES:
        print(f'too few presses ({count}): a calibration needs at least {LEAST_PRESSES}. Continue with --presses 30')
        return 0
    print('enough presses. Next steps:')
    for words in next_steps(folder.table, arguments.sensor, known=body is not None):
        print(f'  {shlex.join(words)}')
    if body is None:
        print(f'BODY is the shape of {indenter or "the indenter"}, e.g. ball:5 or punch:1.5 (radius in mm)')
    if not simulated:
        live = f'source:={arguments.source}', f'sensor:={arguments.sensor}', f'model:={folder.folder / CALIBRATED}'
        print(f'  {shlex.join(["tactile", "launch", "live", *live, "--view"])}')
    return 0


def next_steps(table: Path, sensor: str, *, known: bool) -> list[list[str]]:
    """Commands to run after the presses, in order; `known` is whether the table names the indenter."""
    gel, described = table.resolve().parent.name, str(table.parent / 'described.safetensors')
    body = [] if known else ['--body', 'BODY']
    calibrated, presses = table.parent / CALIBRATED, table.parent / 'presses.npz'
    return [
        ['tactile', 'calibrate', '--sensor', sensor, '--model', 'field', '-o', described],
        ['tactile', 'calibrate', '--pictures', str(table), '--model', described, *body, '--gel', gel,
         '-o', str(calibrated)],
        ['tactile', 'dataset', 'import', str(table), '--model', described, '--gel', gel, '-o', str(presses)],
    ]  # fmt: skip


def _body(indenter: str) -> KnownBody | None:
    """The indenter, if it can be read from its name."""
    from tactile_nodes.errors import ConfigurationError

    try:
        return _known(indenter)
    except ConfigurationError:
        return None


def _known(indenter: str) -> KnownBody:
    from tactile_nodes.learning.field.body import KnownBody

    return KnownBody.named(indenter)


def _forces_n(sensor: Sensor, body: KnownBody | None, given: list[float], unit: str) -> tuple[float, ...]:
    """Forces to press with (N): those given in the unit of the scale, or those within the linear range of the layer."""
    from tactile_nodes.learning.guided.targets import LINEAR_SHARES, digits, linear_most_n
    from tactile_nodes.learning.tables.columns import NEWTONS

    newton = NEWTONS[UNITS[unit]]
    wished = tuple(each * newton for each in given)
    if body is None:
        return wished or tuple(each * NEWTONS['g'] for each in USUAL_G)
    most = linear_most_n(sensor, body)
    range_text = f'under {body.name} the gel responds linearly up to about {digits(most / newton, 2)} {unit}'
    if not wished:
        print(f'{range_text}; the forces asked for stay below that')
    elif max(wished) > most:
        print(f'{range_text}; a calibration of the force field leaves out larger forces')
    return wished or tuple(share * most for share in LINEAR_SHARES)


class TerminalPerson:
    def __init__(self, folder: Path, sensor: Sensor, unit: str, newton: float) -> None:
        self._folder, self._sensor, self._unit, self._newton = folder, sensor, unit, newton
        self._shown = ''  # the line that stands in the terminal without an end

    def leave_untouched(self) -> None:
        print('do not touch the gel …')

    def press(self, target: Target, picture: Picture, done: list[Target]) -> None:
        from tactile_nodes.drivers.camera.pictures import write_png
        from tactile_nodes.learning.guided.drawing import marked, sketch
        from tactile_nodes.learning.guided.targets import digits

        sides_mm = self._sensor.gel.width_mm, self._sensor.gel.height_mm
        drawn = write_png(self._folder / 'next.png', marked(picture, self._sensor, target, done))
        self.end_line()
        print('\n'.join(sketch(sides_mm, target, done)))
        print(
            f'press at x {target.x_mm:g} mm, y {target.y_mm:g} mm (X, and the cross in {drawn}) with about '
            f'{digits(target.force_n / self._newton)} {self._unit}, and hold'
        )

    def sees(self, state: str, place_mm: tuple[float, float]) -> None:
        where = (
            ''
            if state == 'untouched' or math.isnan(place_mm[0])
            else f', about x {round(place_mm[0])}, y {round(place_mm[1])} mm'
        )
        if (line := f'{state}{where}') != self._shown:
            print(f'\r{line:40}', end='', flush=True)
            self._shown = line

    def end_line(self) -> None:
        """Let what comes next begin on a line of its own."""
        if self._shown:
            print()
        self._shown = ''

    def reading(self, target: Target) -> tuple[float, tuple[float, float]] | None:
        self.end_line()
        question = (
            f'steady. Keep holding. What does the scale show [{self._unit}]? (Add x and y in mm if you did not press '
            f'at the mark; {PASSED} skips this press): '
        )
        while True:
            try:
                answer = read_answer(input(question), (target.x_mm, target.y_mm))
            except (EOFError, KeyboardInterrupt):  # Ctrl-D ends it like Ctrl-C
                print()
                raise KeyboardInterrupt from None
            if not isinstance(answer, str):
                return answer
            question = f'{answer}: '

    def say(self, text: str) -> None:
        self.end_line()
        print(text)


def read_answer(text: str, target_mm: tuple[float, float]) -> tuple[float, tuple[float, float]] | str | None:
    """The reading and the position from '50' or '50 3.5 -2'; None for 's'; an error text for any other answer."""
    words = text.replace(',', '.').split()
    if words == [PASSED]:
        return None
    try:
        numbers = [float(each) for each in words]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3) or not all(map(math.isfinite, numbers)):
        return 'enter the reading alone, e.g. 50, or with a position, e.g. 50 3.5 -2'
    if numbers[0] <= 0:
        return 'the reading must be above 0; tare the scale with the sensor on it'
    return numbers[0], (numbers[1], numbers[2]) if len(numbers) == 3 else target_mm
