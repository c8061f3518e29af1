"""A recording of a hand as tables and frames, though its sensors do not all speak from the first message on."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exported_bags import START_NS, STEP_NS, force, picture, write_messages

from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, HAND_WRENCH, IMAGE
from tactile_nodes.cli.main import main
from tactile_nodes.conversions import header, image_message
from tactile_nodes.exporting import lerobot
from tactile_nodes.messages import types

pq = pytest.importorskip('pyarrow.parquet')

SUMMED = [['left'], [], ['left', 'right'], ['left', 'right']]
"""Whose wrench is in the sum of each frame, as at a start: one sensor, none, then both."""


def wrench(number: int) -> types.HandWrench:
    """In the last frame the left sensor has two contacts and the right one one; until then nothing touches."""
    pull = types.Vector3(z=-float(number) if SUMMED[number] else float('nan'))
    margins = [
        types.GraspMargin(sensor=sensor, position=types.Point(x=0.01, y=0.02, z=0.03), margin=margin, normal=2.0)
        for sensor, margin in (('left', 0.25), ('right', 0.5), ('left', 0.75))
    ]
    return types.HandWrench(
        header=header(START_NS + number * STEP_NS, 'gripper'), wrench=types.Wrench(force=pull),
        sensors=SUMMED[number], missing=[each for each in ('left', 'right') if each not in SUMMED[number]],
        margins=margins if number == 3 else [],
    )  # fmt: skip


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    received = []
    for number in range(len(SUMMED)):
        stamp_ns = START_NS + number * STEP_NS
        fingers = [f'/{finger}/{FORCE_DISTRIBUTION.name}' for finger in ('left', 'right')]
        received += [(topic, force(number, stamp_ns), stamp_ns) for topic in fingers]
        received.append((f'/{HAND_WRENCH.name}', wrench(number), stamp_ns))
    return write_messages(tmp_path_factory.mktemp('bags') / 'both', *received)


@pytest.fixture(scope='module')
def table(bag: Path):
    assert main(['export', 'parquet', str(bag), '-o', str(bag.parent / 'tables')]) == 0
    return pq.read_table(bag.parent / 'tables' / 'hand_wrench.parquet')


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('sensors.left', [True, False, True, True]),
        ('sensors.right', [False, False, True, True]),
        ('margins.left.count', [0, 0, 0, 2]),
        ('margins.right.count', [0, 0, 0, 1]),
        ('margins.left.margin', [None, None, None, 0.25]),
        ('margins.right.margin', [None, None, None, 0.5]),
        ('margins.right.position.y', [None, None, None, 0.02]),
        ('wrench.force.z', [0.0, None, -2.0, -3.0]),
    ],
)
def test_each_sensor_of_a_hand_has_columns_of_its_own(table, name: str, values: list[float | None]) -> None:
    expected = [np.nan if value is None else value for value in values]
    np.testing.assert_array_equal(table[name].to_pylist(), expected)


def test_the_columns_of_a_hand_have_units(table) -> None:
    units = {each.name: (each.metadata or {}).get(b'unit') for each in table.schema}
    assert [units[f'margins.left.{name}'] for name in ('position.x', 'normal', 'shear')] == [b'm', b'N', b'N']
    assert units['wrench.torque.x'] == b'N m'


def test_zarr_holds_a_hand_too(bag: Path) -> None:
    zarr = pytest.importorskip('zarr')
    assert main(['export', 'zarr', str(bag), '-o', str(bag.parent / 'both.zarr')]) == 0
    group = zarr.open_group(str(bag.parent / 'both.zarr'), mode='r')['hand_wrench']
    assert group['sensors.right'][:].tolist() == [False, False, True, True]


def test_frames_of_a_hand_hold_the_margin_of_each_sensor_and_whether_it_is_in_the_sum(
    bag: Path, tmp_path: Path
) -> None:
    assert main(['export', 'lerobot', str(bag), '-o', str(tmp_path / 'set'), '--fps', '60', '--pick', 'nearest']) == 0
    info = json.loads((tmp_path / 'set/meta/info.json').read_text())['features']['observation.hand_wrench']
    frames = pq.read_table(tmp_path / 'set/data/chunk-000/file-000.parquet')
    last = dict(zip(info['names'], frames['observation.hand_wrench'][-1].as_py(), strict=True))
    assert (last['margins.left.margin'], last['margins.right.margin']) == (0.25, 0.5)
    place = info['names'].index('sensors.right')
    assert {each[place] for each in frames['observation.hand_wrench'].to_pylist()} == {0.0, 1.0}


def write_pictures(folder: Path, first: dict[str, int]) -> Path:
    """Twelve forces and 13 pictures of each of two fingers; its pictures begin with the number in `first`."""
    received = []
    for number in range(13):
        stamp_ns = START_NS + number * STEP_NS
        for finger, begin in first.items():
            if number < 12:
                received.append((f'/{finger}/{FORCE_DISTRIBUTION.name}', force(number, stamp_ns), stamp_ns))
            if number >= begin:
                seen = image_message(picture(number), header(stamp_ns, finger))
                received.append((f'/{finger}/{IMAGE.name}', seen, stamp_ns))
    return write_messages(folder, *received)


AS_PICTURES = ['--fps', '60', '--images']


def test_an_episode_begins_with_the_pictures_of_the_last_finger(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_pictures(tmp_path / 'both', {'left': 0, 'right': 3})
    assert main(['export', 'lerobot', str(bag), '-o', str(tmp_path / 'set'), *AS_PICTURES]) == 0
    frames = pq.read_table(tmp_path / 'set/data/chunk-000/file-000.parquet')
    assert frames['stamp_ns'][0].as_py() == START_NS + 3 * STEP_NS
    assert 'the first 0.05 s of the forces, before the first message of /right/image_raw' in capsys.readouterr().out


def test_pictures_that_begin_after_the_last_force_are_refused_before_any_frame(
    tmp_path: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_pictures(tmp_path / 'late', {'left': 0, 'right': 12})
    monkeypatch.setattr(lerobot, 'png', lambda _: pytest.fail('a frame was encoded'))
    assert '--exclude /right/image_raw' in refused('lerobot', bag, *AS_PICTURES)
