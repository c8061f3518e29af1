"""A LeRobot data set of a bag: its layout, and frames that took what the bag said, when it said it."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exported_bags import JOINTS, START_NS, STEP_NS, force, picture, write_bag, write_messages, write_presses

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import FORCE_DISTRIBUTION
from tactile_nodes.cli.main import main
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.conversions import header, wrench_message
from tactile_nodes.exporting.features import Feature
from tactile_nodes.exporting.lerobot_files import Meta
from tactile_nodes.exporting.resampling import NEAREST, PREVIOUS, Episode, Resampler, Statistics

pq = pytest.importorskip('pyarrow.parquet')
cv2 = pytest.importorskip('cv2')

BEGIN_NS = START_NS + 3 * STEP_NS - 1_000_000
"""When the joints, the last of all, speak first."""
FORCES = [force(number, START_NS + number * STEP_NS) for number in range(30)]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two bags, the second shorter, at 20 frames a second."""
    made = tmp_path_factory.mktemp('lerobot')
    write_bag(made / 'one')
    write_bag(made / 'two', 20)
    words = ['--fps', '20', '--images', '--state', 'joint_states', '--task', 'press the cup', '--robot', 'arm']
    bags = [str(made / 'one'), str(made / 'two')]
    assert main(['export', 'lerobot', *bags, '-o', str(made / 'set'), *words]) == 0
    return made / 'set'


@pytest.fixture(scope='module')
def first(folder: Path):
    return pq.read_table(folder / 'data/chunk-000/file-000.parquet')


def frames_of(bag: Path, *words: str):
    """The frames of a bag, beside which its data set is made."""
    output = bag.with_name('set')
    assert main(['export', 'lerobot', str(bag), '-o', str(output), *words]) == 0
    return pq.read_table(output / 'data/chunk-000/file-000.parquet')


def episodes_of(bag: Path, *words: str) -> list[dict]:
    """The episodes of a bag of presses, a frame for each force."""
    frames_of(bag, '--cut', 'presses', '--fps', '60', *words)
    return pq.read_table(bag.with_name('set') / 'meta/episodes/chunk-000/file-000.parquet').to_pylist()


def taken(first) -> list[int]:
    """Which message each frame had to take: the last one before it, counted by hand from the stamps."""
    return [max(n for n in range(30) if n * STEP_NS <= at - START_NS) for at in first['stamp_ns'].to_pylist()]


def test_frames_are_at_a_fixed_rate_from_where_all_have_spoken_to_the_last_force(first) -> None:
    # 30 forces at 60 Hz last 483 ms, and joints speak first at 49 ms: frames at 49, 99 … 449 ms.
    assert first['stamp_ns'].to_pylist() == [BEGIN_NS + number * 50_000_000 for number in range(9)]
    assert first['timestamp'].to_pylist() == [pytest.approx(number / 20, abs=1e-7) for number in range(9)]


def test_a_frame_holds_the_force_map_of_the_last_message_before_it(first) -> None:
    maps = first['observation.force_map'].combine_chunks().flatten().to_numpy().reshape(-1, 81)
    assert np.array_equal(maps, [FORCES[number].normal_force for number in taken(first)])


def test_a_frame_says_how_old_its_force_is(first) -> None:
    expected = [
        (at - START_NS - number * STEP_NS) * 1e-9
        for at, number in zip(first['stamp_ns'].to_pylist(), taken(first), strict=True)
    ]
    assert first['age_s.force'].to_numpy() == pytest.approx(expected, abs=1e-9)


def test_a_bag_played_slowly_and_recorded_again_gives_the_same_frames(first, folder: Path, tmp_path: Path) -> None:
    """Receipts begin an hour after the stamps, and fall behind by another 10 s from force to force."""
    writer = BagWriter(tmp_path / 'again')
    with BagReader(folder.parent / 'one') as reader:
        for topic in reader.topics.values():
            writer.add_topic(topic)
        for message in reader.messages():
            later_ns = 3600 * NS_PER_S + 600 * (message.log_ns - START_NS)
            writer.write(message.topic, message.data, message.log_ns + later_ns, message.publish_ns)
    writer.close()
    again = frames_of(tmp_path / 'again', '--fps', '20', '--images', '--state', 'joint_states')
    assert again.schema.names == first.schema.names
    for name in first.schema.names:
        assert str(again[name].to_pylist()) == str(first[name].to_pylist())  # as texts: a NaN equals no other


def test_an_episode_begins_when_all_have_spoken_and_says_how_much_was_left_out(first, folder: Path) -> None:
    assert first['observation.state'][0].as_py() == pytest.approx([1.0, 0.1])
    assert first['age_s.state'][0].as_py() == 0.0
    facts = json.loads((folder / 'tactile.json').read_text())['bags'][0]
    assert (facts['begins_with'], facts['left_out_at_start_s']) == (JOINTS, pytest.approx(0.049, abs=1e-6))


def test_invalid_forces_keep_their_status(tmp_path: Path) -> None:
    write_bag(tmp_path / 'one')
    frames = frames_of(tmp_path / 'one', '--fps', '20', '--exclude', 'joint_states')
    assert frames['observation.status'].to_pylist() == [2, *[0] * 9]
    assert frames['observation.reasons'].to_pylist() == [8, *[0] * 9]


def test_pictures_lie_in_the_frames_without_loss(first) -> None:
    for number, each in zip(taken(first), first['observation.images.image_raw'].to_pylist(), strict=True):
        decoded = cv2.imdecode(np.frombuffer(each['bytes'], np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(decoded, picture(number))


def test_info_describes_every_column_of_the_data(folder: Path, first) -> None:
    info = json.loads((folder / 'meta/info.json').read_text())
    assert (info['codebase_version'], info['fps'], info['robot_type']) == ('v3.0', 20, 'arm')
    assert set(info['features']) == set(first.column_names)
    assert info['features']['observation.state']['names'] == ['position[0]', 'position[1]']
    assert info['data_path'].format(chunk_index=0, file_index=1) == 'data/chunk-000/file-001.parquet'
    assert (info['total_episodes'], info['total_frames']) == (2, 9 + 6)


def test_each_bag_is_an_episode_and_indexes_go_on(folder: Path) -> None:
    episodes = pq.read_table(folder / 'meta/episodes/chunk-000/file-000.parquet').to_pylist()
    assert [(each['dataset_from_index'], each['dataset_to_index']) for each in episodes] == [(0, 9), (9, 15)]
    assert [(each['bag'], each['tasks']) for each in episodes] == [
        ('one', ['press the cup']),
        ('two', ['press the cup']),
    ]
    second = pq.read_table(folder / 'data/chunk-000/file-001.parquet')
    assert second['index'].to_pylist() == list(range(9, 15))
    assert set(second['episode_index'].to_pylist()) == {1}


def test_the_task_is_the_index_of_a_pandas_table(folder: Path) -> None:
    table = pq.read_table(folder / 'meta/tasks.parquet')
    assert table.to_pylist() == [{'task_index': 0, '__index_level_0__': 'press the cup'}]
    assert json.loads(table.schema.metadata[b'pandas'])['index_columns'] == ['__index_level_0__']


def test_statistics_are_those_of_all_frames_together(folder: Path) -> None:
    force = json.loads((folder / 'meta/stats.json').read_text())['observation.total_force']
    files = sorted((folder / 'data').glob('*/*.parquet'))
    values = np.concatenate([pq.read_table(file)['observation.total_force'].to_numpy() for file in files])
    assert (force['count'], force['min'], force['max']) == ([15], [values.min()], [values.max()])
    assert force['mean'] == [pytest.approx(values.mean(dtype=np.float64), rel=1e-6)]
    assert force['std'] == [pytest.approx(values.std(dtype=np.float64), rel=1e-6)]


def test_the_metadata_say_model_gel_units_and_how_it_was_resampled(folder: Path) -> None:
    facts = json.loads((folder / 'tactile.json').read_text())
    assert [bag['model_id'] for bag in facts['bags']] == [['a1b2c3d4e5f6']] * 2
    assert facts['units']['observation.force_map'] == 'N'
    assert facts['units']['observation.wrench'] == ['N'] * 3 + ['N m'] * 3
    assert facts['resampling'].startswith('previous')


@pytest.mark.parametrize(
    ('suspect', 'first'), [(0, (1, 0, '')), (1, (1, 2, 'the anchor lies beside'))], ids=['', 'suspect']
)
def test_cut_at_presses_each_episode_ends_with_its_window_and_says_what_became_of_its_press(
    tmp_path: Path, suspect: int, first: tuple[int, int, str]
) -> None:
    write_presses(tmp_path / 'bag', suspect)
    assert [(each['press'], each['press_status'], each['press_reason']) for each in episodes_of(tmp_path / 'bag')] == [
        first, (2, 1, 'the force drifted'),
    ]  # fmt: skip
    second = pq.read_table(tmp_path / 'set/data/chunk-000/file-001.parquet')
    assert second['stamp_ns'][0].as_py() == START_NS + 20 * STEP_NS
    assert second['stamp_ns'][-1].as_py() <= START_NS + 39 * STEP_NS
    facts = json.loads((tmp_path / 'set/tactile.json').read_text())
    assert list(facts['bags'][0]['force_messages_outside_episodes'].values()) == [20]


def test_presses_of_two_runs_of_one_plan_are_all_episodes(tmp_path: Path) -> None:
    write_presses(tmp_path / 'bag', rigs=('/left/press', '/left/press'))
    found = episodes_of(tmp_path / 'bag')
    assert [(each['press'], each['press_status']) for each in found] == [(1, 0), (1, 1)]


def test_of_rigs_that_press_at_once_one_is_exported(tmp_path: Path, refused: Callable[..., str]) -> None:
    write_presses(tmp_path / 'bag', rigs=('/left/press', '/right/press'))
    said = refused('lerobot', tmp_path / 'bag', '--cut', 'presses')
    assert 'of each alone, the first with --exclude /right/press' in ' '.join(said.split())
    found = episodes_of(tmp_path / 'bag', '--exclude', '/right/press')
    assert [each['press_status'] for each in found] == [0, 1]


def test_presses_without_a_force_of_their_own_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_presses(tmp_path / 'bag', first=25)
    episodes_of(tmp_path / 'bag')
    assert 'left out: presses of bag (1 of 2: no force after the window before' in capsys.readouterr().out


def test_true_forces_are_beside_those_that_were_estimated(tmp_path: Path) -> None:
    topics = 'force_distribution', 'true_force_distribution'
    received = [(f'/{topic}', force(number, START_NS), START_NS + number) for number, topic in enumerate(topics, 1)]
    (row,) = frames_of(write_messages(tmp_path / 'bag', *received), '--topics', *topics).to_pylist()
    names = 'observation.total_force', 'observation.true_force_distribution.total_force'
    assert [row[name] for name in names] == [np.float32(force(number, 0).total) for number in (1, 2)]


def test_a_bag_without_forces_is_refused_with_what_to_do(tmp_path: Path, refused: Callable[..., str]) -> None:
    write_bag(tmp_path / 'bag', 5)
    said = refused('lerobot', tmp_path / 'bag', '--topics', 'wrench')
    assert 'is exported, which sets the times of frames; add it to --topics' in said


def test_a_clock_that_was_set_while_recording_is_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    """A computer without a clock of its own begins in 1970; frames of the decades until then would fill every disk."""
    stamps_ns = [(START_NS if number >= 10 else 60 * NS_PER_S) + number * STEP_NS for number in range(20)]
    received = [(f'/{FORCE_DISTRIBUTION.name}', force(n, stamp_ns), stamp_ns) for n, stamp_ns in enumerate(stamps_ns)]
    said = refused('lerobot', write_messages(tmp_path / 'set', *received))
    assert 'jump by 19676 days, as when a clock is set; export parquet or zarr' in said


def test_a_state_that_is_not_in_the_bag_is_refused_by_name(tmp_path: Path, refused: Callable[..., str]) -> None:
    write_bag(tmp_path / 'bag', 5)
    assert '--state /image_raw' in refused('lerobot', tmp_path / 'bag', '--state', 'image_raw')
    said = refused('lerobot', tmp_path / 'bag', '--state', 'joint_states', '--action', JOINTS)
    assert 'cannot be both observation.state and action' in said


def test_a_topic_with_the_name_of_a_part_of_the_force_has_another_one(tmp_path: Path) -> None:
    """The age of a robot's `/force` would take the place of the age of `/force_distribution`."""
    received = []
    for number in range(20):
        stamp_ns = START_NS + number * STEP_NS
        message = force(number, stamp_ns)
        wrench = dataclasses.replace(wrench_message(message), header=header(stamp_ns - STEP_NS // 2, 'tool'))
        received += [(f'/{FORCE_DISTRIBUTION.name}', message, stamp_ns), ('/force', wrench, stamp_ns)]
    frames = frames_of(write_messages(tmp_path / 'bag', *received), '--fps', '20')
    ages = [np.array(frames[f'age_s.{name}'].to_pylist(), np.float64).reshape(-1) for name in ('force', 'topic.force')]
    assert len(frames) > 3
    assert 'observation.topic.force' in frames.column_names
    np.testing.assert_allclose(abs(ages[1] - ages[0]), STEP_NS / 2e9, atol=1e-6)


def test_bags_of_different_topics_make_no_data_set(tmp_path: Path, refused: Callable[..., str]) -> None:
    write_bag(tmp_path / 'one', 5)
    write_presses(tmp_path / 'two')
    assert 'other features than the bags before it' in refused('lerobot', tmp_path / 'one', tmp_path / 'two')


def test_bags_whose_joints_have_another_order_make_no_data_set(tmp_path: Path, refused: Callable[..., str]) -> None:
    write_bag(tmp_path / 'one', 8)
    write_bag(tmp_path / 'two', 8, ('b', 'a'))
    bags = [str(tmp_path / 'one'), str(tmp_path / 'two')]
    assert f"name of {JOINTS} is ['b', 'a']" in refused('lerobot', *bags)
    assert main(['export', 'lerobot', *bags, '-o', str(tmp_path / 'set'), '--exclude', JOINTS]) == 0


# --- resampling ---------------------------------------------------------------------------------------------

SECOND_NS = 1_000_000_000


def resampled(pick: str, stamps: list[int], fps: int = 10) -> list[object]:
    """What the frames of one second take from messages that are named by their stamps."""
    resampler = Resampler(['/a'], [Episode(0, SECOND_NS // 2)], fps, pick)
    found = [frame for at in stamps for frame in resampler.take('/a', at, at, at)]
    return [frame.picked['/a'].value for frame in [*found, *resampler.finish()]]


def test_the_previous_message_is_never_later_than_its_frame() -> None:
    assert resampled(PREVIOUS, [0, 90_000_000, 110_000_000, 290_000_000]) == [
        0, 90_000_000, 110_000_000, 290_000_000, 290_000_000, 290_000_000,
    ]  # fmt: skip


def test_the_nearest_message_may_be_later_than_its_frame() -> None:
    # At 0.2 s, 290 ms are nearer (90 ms) than 101 ms (99 ms).
    taken_ns = resampled(NEAREST, [0, 98_000_000, 101_000_000, 290_000_000])
    assert taken_ns[1:4] == [101_000_000, 290_000_000, 290_000_000]


def test_messages_received_out_of_order_are_taken_by_their_stamps() -> None:
    assert resampled(PREVIOUS, [0, 110_000_000, 90_000_000])[1] == 90_000_000


def test_messages_are_forgotten_once_no_frame_can_take_them() -> None:
    resampler = Resampler(['/a'], [Episode(0, 1000 * SECOND_NS)], 10, NEAREST)
    for number in range(20_000):  # 200 s at 100 Hz
        list(resampler.take('/a', number * 10_000_000, number * 10_000_000, None))
    # Two seconds are waited for those that come late, and one message before and one frame after are kept.
    assert len(resampler._tracks['/a'].kept) <= 2 * 100 + 12


def test_statistics_count_only_numbers() -> None:
    statistics = Statistics((1,))
    for value in (float('nan'), 1e9, 1e9 + 2):
        statistics.take([value])
    summary = statistics.summary()
    assert summary is not None
    assert (summary['mean'], summary['std'], summary['min'], summary['max']) == ([1e9 + 1], [1.0], [1e9], [1e9 + 2])


def test_a_feature_that_never_was_a_number_has_no_statistics() -> None:
    statistics = Statistics((2,))
    statistics.take([1.0, float('nan')])
    assert statistics.summary() is None


def test_each_sensor_has_its_namespace_in_front_and_frames_are_where_both_speak(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    received = []
    for number in range(12):
        for finger in ['left'] * (number < 10) + ['right'] * (number >= 6):
            stamp_ns = START_NS + number * STEP_NS
            topic = f'/{finger}/{FORCE_DISTRIBUTION.name}'
            received.append((topic, force(number, stamp_ns), stamp_ns + 9_000_000))
    frames = frames_of(write_messages(tmp_path / 'hand', *received), '--fps', '60')
    assert frames['stamp_ns'][0].as_py() == START_NS + 6 * STEP_NS
    maps = [frames[f'observation.{finger}.force_map'][0].as_py() for finger in ('left', 'right')]
    assert maps[0] == maps[1] == force(6, 0).normal_force.tolist()
    assert len(frames) == 4  # the sixth to the ninth force, 60 a second
    facts = json.loads((tmp_path / 'set/tactile.json').read_text())['bags'][0]
    left = f'/left/{FORCE_DISTRIBUTION.name}'
    assert (facts['ends_with'], facts['left_out_at_end_s']) == (left, pytest.approx(2 * STEP_NS / NS_PER_S))
    assert f'left out: the last 0.03 s of the forces, after the last message of {left}' in capsys.readouterr().out


def test_statistics_of_episodes_with_unequal_gaps_are_those_of_all_numbers(tmp_path: Path) -> None:
    """A contact is NaN while nothing touches, and in an episode without any touch throughout."""
    meta, nan = Meta(tmp_path, 30, 'touch', 'hand'), float('nan')
    meta.agree([Feature('observation.contact', '/contact', 'float32', ('x',), (0,))], {}, tmp_path)
    for values in ([1.0, nan, nan, nan], [nan, nan], [3.0, 4.0, 5.0, nan]):
        file = meta.open_episode()
        for number, value in enumerate(values):
            file.take(number, number, {'observation.contact': np.float32(value)})
        meta.close_episode(file, {}, {})
    meta.close({})
    found = json.loads((tmp_path / 'meta/stats.json').read_text())['observation.contact']
    assert (found['min'], found['max'], found['count']) == ([1.0], [5.0], [10])
    assert found['mean'] == pytest.approx([3.25])  # (1 + 3 + 4 + 5) / 4
    assert found['std'] == pytest.approx([math.sqrt(35 / 16)])  # (81 + 1 + 9 + 49) / 16 / 4
