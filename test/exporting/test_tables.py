"""What parquet and zarr hold is what the bag's messages said, read back with the readers that learners use."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from exported_bags import JOINTS, START_NS, STEP_NS, force, picture, write_bag, write_messages

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.cli.main import main
from tactile_nodes.conversions import header, wrench_message
from tactile_nodes.exporting import tables
from tactile_nodes.messages import types

pq = pytest.importorskip('pyarrow.parquet')


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('bags') / 'grasp'
    write_bag(folder)
    return folder


@pytest.fixture(scope='module')
def zarr_root(bag: Path):
    zarr = pytest.importorskip('zarr')
    output = bag.parent / 'grasp.zarr'
    assert main(['export', 'zarr', str(bag), '-o', str(output), '--images']) == 0
    return zarr.open_group(str(output), mode='r')


def test_features_before_and_after_a_knock_of_the_camera_are_one_table(tmp_path: Path) -> None:
    still, moved = (
        types.FlowFeatures(values=np.ones(4, np.float32), picture_motion=np.array(motion, np.float32))
        for motion in ([], range(8))
    )
    write_messages(tmp_path / 'knocked', ('/flow_features', still, START_NS), ('/flow_features', moved, START_NS + 1))
    words = [str(tmp_path / 'knocked'), '-o', str(tmp_path / 'tables'), '--topics', 'flow_features']
    assert main(['export', 'parquet', *words]) == 0
    motions = pq.read_table(tmp_path / 'tables/flow_features.parquet')['picture_motion'].to_pylist()
    assert np.isnan(motions[0]).all() and motions[1] == list(range(8))


def test_what_a_rig_records_of_its_devices_does_not_stop_an_export(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Batches of counts, the last of which is shorter, and bytes of lines."""
    received = [
        (topic, message, START_NS + length)
        for length in (3, 2)
        for topic, message in (
            ('/force_torque_counts', types.ForceTorqueCounts(measured=np.zeros(length, np.uint32))),
            ('/serial_traffic', types.SerialTraffic(data=np.zeros(length, np.uint8))),
            ('/wrench', types.WrenchStamped()),
        )
    ]
    write_messages(tmp_path / 'collected', *received)
    assert main(['export', 'parquet', str(tmp_path / 'collected'), '-o', str(tmp_path / 'tables')]) == 0
    assert '/serial_traffic (bytes of any length)' in capsys.readouterr().out


FORCES = [force(number, START_NS + number * STEP_NS) for number in range(30)]


def test_parquet_holds_every_force_map_bit_for_bit(parquet: Path) -> None:
    table = pq.read_table(parquet / 'force_distribution.parquet')
    maps = table['normal_force'].combine_chunks().flatten().to_numpy().reshape(-1, 9, 9)
    assert maps.dtype == np.float32
    assert np.array_equal(maps, [each.normal_force.reshape(9, 9) for each in FORCES])


@pytest.mark.parametrize('name', ['total', 'total_sigma', 'peak', 'in_contact', 'status', 'reasons', 'unlikeness'])
def test_parquet_holds_the_numbers_of_every_force_message(parquet: Path, name: str) -> None:
    column = pq.read_table(parquet / 'force_distribution.parquet')[name].to_numpy()
    np.testing.assert_array_equal(column, [getattr(each, name) for each in FORCES])


def test_parquet_holds_the_strongest_contact_with_its_sigmas(parquet: Path) -> None:
    table = pq.read_table(parquet / 'force_distribution.parquet')
    names = ['contact.x', 'contact.y', 'strongest.force', 'strongest.force_sigma', 'strongest.position_sigma']
    assert [table[name][5].as_py() for name in names] == [1e-3 / 3, -2e-3, 0.1, 0.01, 1e-4 / 3]


def test_without_a_contact_its_columns_are_no_numbers(parquet: Path) -> None:
    table = pq.read_table(parquet / 'force_distribution.parquet')
    assert table['contact_count'][1].as_py() == 0
    assert np.isnan([table['contact.x'][1].as_py(), table['strongest.force'][1].as_py()]).all()


def test_stamps_are_those_of_capture_to_the_nanosecond(parquet: Path) -> None:
    table = pq.read_table(parquet / 'force_distribution.parquet')
    assert table['stamp_ns'].to_pylist() == [START_NS + number * STEP_NS for number in range(30)]
    assert table['received_ns'][7].as_py() == START_NS + 7 * STEP_NS + 9_000_000


def test_invalid_messages_are_kept_with_their_reasons(parquet: Path) -> None:
    first = pq.read_table(parquet / 'force_distribution.parquet').slice(0, 1).to_pylist()[0]
    assert (first['status'], first['reasons']) == (2, 8)
    assert json.loads((parquet / 'tactile.json').read_text())['force_messages_of_status'] == {'0': 29, '2': 1}


def test_wrenches_and_joints_have_tables_and_stamps_of_their_own(parquet: Path) -> None:
    wrench = pq.read_table(parquet / 'wrench.parquet')
    expected = [wrench_message(each).wrench.force.z for each in FORCES]  # NaN where the force is invalid
    np.testing.assert_array_equal(wrench['wrench.force.z'].to_pylist(), expected)
    joints = pq.read_table(parquet / 'joint_states.parquet')
    assert joints['stamp_ns'][0].as_py() == START_NS + 3 * STEP_NS - 1_000_000
    assert joints['position'].to_pylist() == [[number / 3, 0.1] for number in range(3, 30, 3)]


def test_the_footer_says_units_frame_model_gel_and_command(parquet: Path) -> None:
    file = parquet / 'force_distribution.parquet'
    facts = json.loads(pq.read_metadata(file).metadata[b'tactile'])
    topic = facts['topics']['/force_distribution']
    assert (facts['model_id'], facts['calibration_id'], facts['gel']) == (['a1b2c3d4e5f6'], ['0123456789ab'], ['gel7'])
    assert (topic['frames'], topic['units']['total'], topic['units']['contact.x']) == (['gel_surface'], 'N', 'm')
    assert 'positive presses into the gel' in facts['signs']
    assert facts['command'].startswith('tactile')
    assert pq.read_schema(file).field('normal_force').metadata == {b'unit': b'N', b'shape': b'[9, 9]'}


def test_the_fingerprint_follows_the_data(bag: Path, parquet: Path, tmp_path: Path) -> None:
    write_bag(tmp_path / 'other', 29)
    assert main(['export', 'parquet', str(tmp_path / 'other'), '-o', str(tmp_path / 'out')]) == 0
    found = {
        json.loads((each / 'tactile.json').read_text())['data_fingerprint'] for each in (parquet, tmp_path / 'out')
    }
    assert len(found) == 2


def test_names_of_joints_stand_beside_their_table(parquet: Path) -> None:
    facts = json.loads((parquet / 'tactile.json').read_text())
    assert facts['topics'][JOINTS]['constant'] == {'name': ['a', 'b']}


def test_rows_are_written_in_groups_and_none_is_lost(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, 'BATCH_ROWS', 8)
    assert main(['export', 'parquet', str(bag), '-o', str(tmp_path / 'out')]) == 0
    file = pq.ParquetFile(tmp_path / 'out' / 'force_distribution.parquet')
    assert [file.metadata.row_group(number).num_rows for number in range(file.num_row_groups)] == [8, 8, 8, 6]
    assert file.read()['peak'].to_pylist() == [each.peak for each in FORCES]


def test_a_bag_cut_short_is_exported_up_to_the_cut(bag: Path, tmp_path: Path) -> None:
    (source,) = bag.glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    assert main(['export', 'parquet', str(cut), '-o', str(tmp_path / 'out')]) == 0
    totals = pq.read_table(tmp_path / 'out' / 'force_distribution.parquet')['total'].to_pylist()
    assert 0 < len(totals) < 30
    assert totals == [each.total for each in FORCES[: len(totals)]]
    assert json.loads((tmp_path / 'out' / 'tactile.json').read_text())['problems']


def test_zarr_holds_the_same_as_arrays(zarr_root) -> None:
    group = zarr_root['force_distribution']
    assert np.array_equal(group['normal_force'][:], [each.normal_force.reshape(9, 9) for each in FORCES])
    assert group['stamp_ns'][:].tolist() == [messages.stamp_ns(each.header.stamp) for each in FORCES]
    np.testing.assert_array_equal(group['total_sigma'][:], [each.total_sigma for each in FORCES])
    assert group['total'].attrs['unit'] == 'N'


def test_zarr_tells_texts_by_their_labels(zarr_root) -> None:
    model = zarr_root['force_distribution']['provenance.model']
    assert [model.attrs['labels'][code] for code in model[:]] == ['fast'] * 30


def test_zarr_is_of_the_format_that_most_readers_know(zarr_root) -> None:
    assert zarr_root.metadata.zarr_format == 2
    assert zarr_root.attrs['gel'] == ['gel7']


def test_zarr_holds_the_pictures_when_asked_for(zarr_root) -> None:
    assert np.array_equal(zarr_root['image_raw']['pixels'][:], [picture(number) for number in range(30)])


def test_zarr_names_no_fill_value_and_writes_every_chunk(bag: Path, zarr_root) -> None:
    # xarray turns what equals a fill value into NaN; without one, a chunk that is not there is read as anything.
    folder = bag.parent / 'grasp.zarr' / 'force_distribution'
    assert json.loads((folder / 'cols' / '.zarray').read_text())['fill_value'] is None
    assert not zarr_root['force_distribution']['provenance.model'][:].any()  # all are the first of the labels
    assert (folder / 'provenance.model' / '0').is_file()


ARM_STATE = f"""\
std_msgs/Header header
float64 torque
{'=' * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{'=' * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def test_stamps_of_a_type_that_only_the_bag_knows_are_those_of_its_headers(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / 'arm')
    writer.add_topic(BagTopic('/arm', 'arm_msgs/msg/State', ARM_STATE))
    for number in range(3):
        stamp_ns = START_NS + number * STEP_NS
        # A wrench is a header and six numbers of 8 bytes each: without the last five it has the layout of a state.
        data = messages.encode(types.WrenchStamped(header=header(stamp_ns, 'base')))[:-40]
        writer.write('/arm', data, stamp_ns + 45_000_000, stamp_ns + 40_000_000)
    writer.close()
    assert main(['export', 'parquet', str(tmp_path / 'arm'), '-o', str(tmp_path / 'tables')]) == 0
    table = pq.read_table(tmp_path / 'tables/arm.parquet')
    assert table['stamp_ns'].to_pylist() == [START_NS + number * STEP_NS for number in range(3)]
    facts = json.loads((tmp_path / 'tables/tactile.json').read_text())
    assert facts['topics']['/arm']['stamp'] == 'capture, from the header'
