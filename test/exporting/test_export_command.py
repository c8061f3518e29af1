"""`tactile export` refuses, cleans up and explains."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exported_bags import START_NS, force, write_bag, write_messages

from tactile_nodes.cli.main import INTERRUPTED, main
from tactile_nodes.conversions import header, image_pixels
from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.exporting import libraries
from tactile_nodes.exporting.output import FACTS, made_whole
from tactile_nodes.exporting.parquet import ParquetSink
from tactile_nodes.exporting.source import Source
from tactile_nodes.learning.progress import Bar
from tactile_nodes.messages import types
from tactile_nodes.viewing.force_shapes import force_map

pytest.importorskip('pyarrow')
pq = pytest.importorskip('pyarrow.parquet')


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    write_bag(tmp_path / 'grasp', 5)
    return tmp_path / 'grasp'


def test_an_export_that_is_there_is_replaced_only_with_force(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = bag.parent / 'out'
    words = ['export', 'parquet', str(bag), '-o', str(output)]
    assert [main(words), main(words), main([*words, '--force'])] == [0, 1, 0]
    assert '--force' in capsys.readouterr().err


def test_all_messages_count_as_done_at_the_end(bag: Path) -> None:
    done: list[int] = []
    with Source(bag) as source:
        assert len(list(source.messages(Bar(lambda steps, _: done.append(steps))))) == source.count == sum(done)


def test_a_dot_in_the_name_of_a_bag_is_kept_in_that_of_its_export(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for depth in ('0.5mm', '0.8mm'):  # both were press_0, and --force replaced one by the other
        write_bag(Path(f'press_{depth}'), 5)
        assert main(['export', 'parquet', f'press_{depth}', '--force']) == 0
    assert main(['export', 'parquet', 'press_0.5mm/press_0.5mm_0.mcap']) == 0
    exports = sorted(each.name for each in tmp_path.iterdir() if each.name.endswith('_parquet'))
    assert exports == ['press_0.5mm_0_parquet', 'press_0.5mm_parquet', 'press_0.8mm_parquet']


def test_a_folder_of_somebody_else_is_never_replaced(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = bag.parent / 'mine'
    output.mkdir()
    (output / 'thesis.txt').write_text('years of work')
    assert main(['export', 'parquet', str(bag), '-o', str(output), '--force']) == 1
    assert (output / 'thesis.txt').read_text() == 'years of work'
    assert 'not an export' in capsys.readouterr().err


@pytest.mark.parametrize('kind', ['parquet', 'lerobot'])
def test_what_was_lost_and_what_is_left_out_is_reported(
    kind: str, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = bag.parent / 'cut.mcap'
    (whole,) = bag.glob('*.mcap')
    cut.write_bytes(whole.read_bytes()[:-1000])  # what follows the messages, and no more
    assert main(['export', kind, str(cut), '-o', str(bag.parent / 'out')]) == 0
    printed = capsys.readouterr()
    assert f'Warning: {cut} is cut off' in printed.err
    assert 'left out: /image_raw (images; with --images zarr holds them, lerobot those of 8 bits)' in printed.out


def test_without_anything_to_export_each_topic_says_why(bag: Path, refused: Callable[..., str]) -> None:
    error = refused('parquet', bag, '--topics', '/image_raw')
    assert 'contains nothing to export: ' in error
    assert '/image_raw (images; with --images zarr holds them, lerobot those of 8 bits)' in error


def test_ctrl_c_leaves_nothing_behind(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ParquetSink, 'write', interrupt)
    before = set(bag.parent.iterdir())
    assert main(['export', 'parquet', str(bag), '-o', str(bag.parent / 'out')]) == INTERRUPTED
    assert set(bag.parent.iterdir()) == before


def test_of_two_exports_to_one_place_at_once_the_second_is_refused_and_the_first_is_whole(tmp_path: Path) -> None:
    """The second one began by deleting what the first one had written, which then lacked files and said nothing."""
    output = tmp_path / 'out'
    with made_whole(output) as draft:
        (draft / 'forces').touch()
        with pytest.raises(DatasetError, match='another command is writing'), made_whole(output):
            pass
    assert [each.name for each in output.iterdir()] == ['forces']
    assert list(tmp_path.iterdir()) == [output]


def test_ctrl_c_while_the_export_before_is_deleted_leaves_the_new_one_whole(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once while it is deleted, or at each try: then a hidden copy of it stays until the next export."""
    output, delete, interrupted = bag.with_name('replaced'), shutil.rmtree, []
    words = ['export', 'parquet', str(bag), '-o', str(output)]
    assert main(words) == 0
    for often in (1, 10):
        (output / 'force_distribution.parquet').write_bytes(b'of the export before')
        interrupted.clear()

        def interrupt(folder: Path, often: int = often, **options: bool) -> None:
            if (folder / FACTS).exists() and len(interrupted) < often:
                interrupted.append(folder)
                raise KeyboardInterrupt
            delete(folder, **options)

        with monkeypatch.context() as patch:
            patch.setattr(shutil, 'rmtree', interrupt)
            assert main([*words, '--force']) == INTERRUPTED
        assert len(pq.read_table(output / 'force_distribution.parquet')) == 5
        if often > 1:
            assert main([*words, '--force']) == 0
        assert [each.name for each in bag.parent.iterdir() if 'replaced' in each.name] == ['replaced']


def test_ctrl_c_before_the_new_export_has_its_name_keeps_the_one_before(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output, rename = bag.with_name('replaced'), Path.rename
    words = ['export', 'parquet', str(bag), '-o', str(output)]
    assert main(words) == 0
    (output / 'mark').touch()

    def interrupt(self: Path, target: Path) -> Path:
        if self.suffix == '.part':
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, 'rename', interrupt)
    assert main([*words, '--force']) == INTERRUPTED
    assert [each.name for each in bag.parent.iterdir() if 'replaced' in each.name] == ['replaced']
    assert (output / 'mark').exists()


def test_without_the_library_one_sentence_says_what_to_install(
    bag: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> None:
        raise ImportError(f'No module named {name!r}')

    monkeypatch.setattr(libraries.importlib, 'import_module', missing)
    with pytest.raises(ConfigurationError, match=r"'zarr'.*pip install 'tactile_nodes\[export\]'"):
        libraries.require('zarr')


def test_only_the_topics_asked_for_are_exported(bag: Path) -> None:
    output = bag.parent / 'out'
    assert main(['export', 'parquet', str(bag), '-o', str(output), '--topics', 'wrench']) == 0
    assert [file.name for file in output.glob('*.parquet')] == ['wrench.parquet']
    assert json.loads((output / 'tactile.json').read_text())['topics_left_out']['/joint_states'] == 'not requested'


def test_a_grid_that_changes_within_a_bag_is_refused_by_name(tmp_path: Path, refused: Callable[..., str]) -> None:
    first = force(3, START_NS)
    other = types.ForceDistribution(
        header=header(START_NS + 1, ''), rows=5, cols=5, normal_force=np.ones(25, np.float32)
    )
    bag = write_messages(tmp_path / 'two', ('/f', first, START_NS), ('/f', other, START_NS + 1))
    assert 'normal_force of /f has the shape (9, 9)' in refused('parquet', bag)


def test_forces_whose_size_contradicts_their_rows_and_columns_are_left_out_with_their_reason(
    tmp_path: Path, refused: Callable[..., str]
) -> None:
    odd = types.ForceDistribution(
        header=header(START_NS, ''), rows=2**20, cols=2**20, normal_force=np.ones(25, np.float32)
    )
    said = '/f (normal_force has 25 values for 1048576 rows and 1048576 columns)'
    assert said in refused('parquet', write_messages(tmp_path / 'odd', ('/f', odd, START_NS)))


def test_colours_come_out_red_first() -> None:
    message = types.Image(height=1, width=1, encoding='bgr8', step=3, data=np.array([1, 2, 3], np.uint8))
    assert image_pixels(message).tolist() == [[[3, 2, 1]]]


def test_depth_of_32_bits_keeps_its_bits() -> None:
    depths = np.array([[0.1, 2.5]], '<f4')
    message = types.Image(height=1, width=2, encoding='32FC1', step=8, data=depths.view(np.uint8).reshape(-1).copy())
    assert np.array_equal(image_pixels(message), depths)


def test_a_picture_of_no_size_is_left_out_with_its_reason(tmp_path: Path) -> None:
    pytest.importorskip('zarr')
    empty = types.Image(header=header(START_NS, 'camera'), encoding='mono8')
    write_messages(tmp_path / 'bag', ('/picture', empty, START_NS), ('/f', force(1, START_NS), START_NS + 1))
    assert main(['export', 'zarr', str(tmp_path / 'bag'), '-o', str(tmp_path / 'out'), '--images']) == 0
    description = json.loads((tmp_path / 'out' / 'tactile.json').read_text())
    assert description['topics_left_out'] == {'/picture': 'empty in every message'}


def test_a_force_map_in_newtons_is_left_out_of_a_data_set_of_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A viewer may have subscribed to it while the bag was recorded, as for the bag of the examples."""
    made = force(1, START_NS)
    write_messages(
        tmp_path / 'bag', ('/force_map', force_map(made), START_NS), ('/force_distribution', made, START_NS + 1)
    )
    words = ['export', 'lerobot', str(tmp_path / 'bag'), '--images']
    assert main([*words, '-o', str(tmp_path / 'out')]) == 0
    assert 'left out: /force_map (pictures of float32 do not fit into the 8 bits' in capsys.readouterr().out
    features = json.loads((tmp_path / 'out' / 'meta' / 'info.json').read_text())['features']
    assert not [name for name in features if 'images' in name]
