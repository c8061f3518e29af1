"""Presses on two gels in one data set: a sentence names both bags or tables, and the data set is made all the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from press_bags import OTHER, SECOND_NS, START_NS, Collection, Sensor
from told import Told

from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.imported.importing import Imported, import_presses
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.learning.recorded.gels import Gels
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.learning.tables.pictures import FolderPictures
from tactile_nodes.learning.tables.presses import read_table

pytestmark = pytest.mark.usefixtures('own_cache')

COARSE = BuildOptions(encoding=Choice('cartesian_mean', {'rows': 20, 'cols': 20}), without_contact=0.0)


def warnings(told: Told) -> list[str]:
    return [each for each in told.lines if 'markers' in each]


def collected(folder: Path, hour: int, sensors: Sequence[Sensor]) -> Path:
    """A bag with a press on each of these, after a rest image."""
    collection = Collection(folder / str(hour), sensors[0], START_NS + 3600 * hour * SECOND_NS)
    for slot, collection.sensor in enumerate(sensors):
        collection.reference(slot)
        collection.press(slot, slot + 1, 0.0, 0.0, 0.5)
    return collection.close()


def pressed(folder: Path, sensor: Sensor) -> Imported:
    """A table with two rest images and two presses."""
    folder.mkdir()
    touches = [sensor.touching(x_mm, 0.0, depth_mm) for x_mm, depth_mm in ((-3.0, 0.5), (3.0, 1.0))]
    for name, image in (
        *((f'rest{number}', sensor.image()) for number in range(2)),
        *((f'press{number}', sensor.image(each)) for number, each in enumerate(touches)),
    ):
        cv2.imwrite(str(folder / f'{name}.png'), image)
    table = folder / 'presses.csv'
    rows = 'rest0.png,,,0', 'rest1.png,,,0', 'press0.png,-3,0,0.1', 'press1.png,3,0,0.3'
    table.write_text('\n'.join(['picture,x_mm,y_mm,force_n', *rows]) + '\n')
    return Imported(read_table(table), FolderPictures(folder))


def test_bags_of_two_gels_are_named_once_for_each_rest_image(tmp_path: Path, sensor: Sensor) -> None:
    """Two bags of one gel, each with noise of its own, then one of another gel, with two rest images."""
    told, other = Told(), Sensor(OTHER)
    bags = [collected(tmp_path, hour, of) for hour, of in enumerate(([sensor], [sensor], [other, other]))]
    assert len(build(bags, replace(COARSE, separate_runs=True), told)) == 4
    sentence = f'{bags[2]}: a rest image shows other markers than the first one of {bags[0]}: it is another gel'
    assert [each.startswith(sentence) for each in warnings(told)] == [True, True]


def test_tables_of_two_gels_are_named(tmp_path: Path, sensor: Sensor) -> None:
    told = Told()
    sources = [pressed(tmp_path / name, of) for name, of in (('a', sensor), ('b', sensor), ('c', Sensor(OTHER)))]
    assert import_presses(sources, COARSE, progress=told, forced=True).contact.sum() == 6
    first, _, other = (each.table.file for each in sources)
    assert [each.split(': it is')[0] for each in warnings(told)] == [
        f'{other}: a rest image shows other markers than the first one of {first}'
    ]


def test_before_there_is_a_rest_image_nothing_is_said() -> None:
    told = Told()
    gels = Gels(told)
    with Measurer(COARSE.flow, COARSE.encoding) as measurer:
        gels.see(Path('a'), measurer)
        measurer.use_reference(np.random.default_rng(1).integers(0, 255, (440, 440), np.uint8))
        gels.see(Path('b'), measurer)
    assert warnings(told) == []
