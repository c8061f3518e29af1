"""Shear, torsion and fine maps in exports, and bags of before they were published."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from exported_bags import START_NS, STEP_NS, write_messages
from seen import BINS, CELLS, ring

from tactile_nodes import conversions
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION, FORCE_FIELD
from tactile_nodes.cli.main import main
from tactile_nodes.messages import types
from tactile_nodes.sensing.explain.reading import nothing_read

pq = pytest.importorskip('pyarrow.parquet')
EARLIER = Path(__file__).parents[2] / 'examples/press_bag'


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An invalid frame, which holds no maps, and three of a ring with its field."""
    nothing = nothing_read(BINS).normal_force_n
    invalid = types.ForceDistribution(
        header=conversions.header(START_NS, 'gel_surface'), status=2, **conversions.force_fields(nothing, BINS)
    )
    received = [(f'/{FORCE_DISTRIBUTION.name}', invalid, START_NS)]
    for number in range(1, 4):
        stamp_ns = START_NS + number * STEP_NS
        for topic, message in zip((FORCE_DISTRIBUTION, FORCE_FIELD), ring(stamp_ns), strict=True):
            received.append((f'/{topic.name}', message, stamp_ns))
    return write_messages(tmp_path_factory.mktemp('bags') / 'ring', *received)


def test_shear_stands_on_each_bin_and_is_nan_where_it_was_not_reported(parquet: Path) -> None:
    file = parquet / 'force_distribution.parquet'
    along_x = pq.read_table(file)['shear_force_x'].combine_chunks().flatten().to_numpy().reshape(-1, 81)
    assert np.isnan(along_x[0]).all()
    assert along_x[1:].sum(axis=1) == pytest.approx([0.6] * 3, abs=1e-5)
    assert pq.read_schema(file).field('shear_force_x').metadata == {b'unit': b'N', b'shape': b'[9, 9]'}


def test_torsion_size_and_wrench_have_columns_with_units(parquet: Path) -> None:
    table = pq.read_table(parquet / 'force_distribution.parquet')
    units = {each.name: (each.metadata or {}).get(b'unit') for each in table.schema}
    for name, value, unit in (
        ('strongest.torsion', 4e-3, b'N m'), ('strongest.shear_x', 0.6, b'N'), ('strongest.length', 0.0113, b'm'),
        ('strongest.slip_share', 0.2, b'0 to 1'), ('wrench.force.z', -2.0, b'N'), ('wrench.torque.y', 8e-3, b'N m'),
        ('explanation', 3, None),
    ):  # fmt: skip
        assert (table[name][1].as_py(), units[name]) == (pytest.approx(value, rel=1e-5), unit)


def test_a_field_has_a_table_of_its_own_in_pascals(parquet: Path) -> None:
    file = parquet / 'force_field.parquet'
    pressure = pq.read_table(file)['pressure'].combine_chunks().flatten().to_numpy().reshape(-1, CELLS, CELLS)
    assert pressure.shape == (3, CELLS, CELLS)
    assert pressure[0].sum() == pytest.approx(2e6, rel=1e-5)  # 2 N on cells of 1 mm²
    assert pq.read_schema(file).field('shear_y').metadata[b'unit'] == b'Pa'


def lerobot(bag: Path, output: Path) -> dict[str, list[int]]:
    assert main(['export', 'lerobot', str(bag), '-o', str(output), '--fps', '30']) == 0
    features = json.loads((output / 'meta' / 'info.json').read_text())['features']
    return {name: feature['shape'] for name, feature in features.items() if name.startswith('observation.')}


def test_frames_for_learning_hold_shear_maps_and_the_field(bag: Path, tmp_path: Path) -> None:
    found = lerobot(bag, tmp_path / 'ring')
    assert found['observation.shear_map'] == [162]
    assert found['observation.contact_shear'] == [3]
    assert found['observation.force_field.pressure'] == [CELLS * CELLS]
    assert found['observation.force_field.shear'] == [2 * CELLS * CELLS]


def test_a_bag_of_before_shear_was_reported_is_exported_with_nan_and_no_features_of_it(tmp_path: Path) -> None:
    assert main(['export', 'parquet', str(EARLIER), '-o', str(tmp_path / 'tables')]) == 0
    table = pq.read_table(tmp_path / 'tables' / 'force_distribution.parquet')
    assert np.isnan(table['strongest.shear_x'].to_numpy()).all()
    assert np.nanmax(table['strongest.force'].to_numpy()) == pytest.approx(max(table['total'].to_pylist()), abs=1e-3)
    assert 'observation.shear_map' not in lerobot(EARLIER, tmp_path / 'frames')
