"""Where things are, and who may enter."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError


@pytest.fixture(autouse=True)
def _no_run_folder_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('TACTILE_RUN_DIR', raising=False)
    monkeypatch.delenv('XDG_RUNTIME_DIR', raising=False)
    monkeypatch.setattr(paths, '_LOGINS', '/proc/none')


def test_share_folder_holds_the_messages_and_the_manifest() -> None:
    share = paths.share_directory()
    assert (share / 'package.xml').is_file()
    assert (share / 'msg' / 'ForceDistribution.msg').is_file()


def test_run_folder_is_the_chosen_one_and_is_made_for_its_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path / 'run'))
    assert paths.run_directory() == tmp_path / 'run'
    assert stat.S_IMODE((tmp_path / 'run').stat().st_mode) == 0o700


def test_run_folder_does_not_depend_on_where_a_process_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('TACTILE_RUN_DIR', 'run')
    assert paths.run_directory() == tmp_path / 'run'


def test_run_folder_lies_in_the_users_runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    assert paths.run_directory() == tmp_path / 'tactile'


def test_a_service_without_a_login_uses_the_runtime_folder_of_its_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f'{os.getuid()}').mkdir()
    monkeypatch.setattr(paths, '_LOGINS', str(tmp_path))
    assert paths.run_directory() == tmp_path / f'{os.getuid()}/tactile'


def test_run_folder_lies_in_the_temporary_folder_when_there_is_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path / 'none'))
    assert paths.run_directory() == tmp_path / f'tactile-{os.getuid()}'


def test_folder_that_others_may_enter_is_refused_saying_how_to_forbid_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o755)
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path))
    with pytest.raises(ConfigurationError, match=r'is accessible to others; fix it with: chmod 700'):
        paths.run_directory()


def test_symbolic_link_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'link').symlink_to(tmp_path)
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path / 'link'))
    with pytest.raises(
        ConfigurationError, match=r'link is a symbolic link, .*set TACTILE_RUN_DIR to the folder itself'
    ):
        paths.run_directory()


def test_folder_below_a_file_is_refused_saying_what_to_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'file').write_text('')
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path / 'file' / 'run'))
    with pytest.raises(ConfigurationError, match=r'Not a directory.*; set TACTILE_RUN_DIR to a folder of your own'):
        paths.run_directory()


@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder away')
def test_folder_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'theirs').mkdir(mode=0o700)
    os.chown(tmp_path / 'theirs', 65534, 65534)
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path / 'theirs'))
    with pytest.raises(ConfigurationError, match='is not owned by user 0; set TACTILE_RUN_DIR'):
        paths.run_directory()


@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder away')
def test_runtime_folder_of_another_user_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'theirs').mkdir(mode=0o700)
    os.chown(tmp_path / 'theirs', 65534, 65534)
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path / 'theirs'))
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    assert paths.run_directory() == tmp_path / 'tactile-0'


def test_folder_that_cannot_be_made_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TACTILE_RUN_DIR', '/proc/run')  # where not even root may make one
    with pytest.raises(ConfigurationError, match='cannot use /proc/run for the sockets of the bus'):
        paths.run_directory()


def test_logs_go_where_ros_2_puts_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('ROS_LOG_DIR', raising=False)
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    assert paths.log_directory() == tmp_path / 'log'
    monkeypatch.setenv('ROS_LOG_DIR', '/elsewhere')
    assert paths.log_directory() == Path('/elsewhere')


def test_an_empty_variable_names_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ('ROS_LOG_DIR', 'ROS_HOME', 'XDG_STATE_HOME'):
        monkeypatch.setenv(variable, '')
    monkeypatch.setenv('HOME', '/home/jo')
    assert paths.log_directory() == Path('/home/jo/.ros/log')
    assert paths.state_directory() == Path('/home/jo/.local/state/tactile_nodes')


def test_who_has_no_home_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(_: object) -> Path:
        raise RuntimeError('Could not determine home directory.')

    monkeypatch.setattr(Path, 'home', classmethod(nowhere))
    monkeypatch.delenv('XDG_STATE_HOME', raising=False)
    with pytest.raises(ConfigurationError, match='no home folder; set HOME or XDG_STATE_HOME'):
        paths.state_directory()
    monkeypatch.setenv('ROS_HOME', '/logs')
    monkeypatch.delenv('ROS_LOG_DIR', raising=False)
    assert paths.log_directory() == Path('/logs/log')


def test_a_cache_that_cannot_be_made_is_refused_saying_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', '/proc/none')
    with pytest.raises(ConfigurationError, match='cannot create the cache folder /proc/none'):
        paths.cache_directory()


@pytest.mark.parametrize('name', ['', '.', 'folder', 'x' * 300, 'file/below', 'pipe', 'to_pipe'])
def test_an_output_that_cannot_be_is_refused_before_any_work(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('folder').mkdir()
    Path('file').touch()
    os.mkfifo('pipe')
    Path('to_pipe').symlink_to('pipe')
    with pytest.raises(ConfigurationError, match='cannot write'):
        paths.check_output(Path(name))
    assert stat.S_ISFIFO(Path('pipe').stat().st_mode)


@pytest.mark.parametrize('name', ['new', 'there', 'folder/new', 'none/yet/new', 'dangling'])
def test_an_output_that_can_be_is_left_as_it_is(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path('folder').mkdir()
    Path('there').write_text('before')
    Path('dangling').symlink_to('nothing')
    before = sorted(tmp_path.rglob('*'))
    paths.check_output(Path(name))
    assert sorted(tmp_path.rglob('*')) == before
    assert Path('there').read_text() == 'before'


def test_a_file_that_two_processes_write_at_once_is_whole_and_neither_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As two trainings with the same simulated presses do: the second begins while the first has yet to rename."""
    file, write = tmp_path / 'block.npz', Path.write_bytes

    def written_meanwhile(draft: Path, content: bytes) -> int:
        count = write(draft, content)
        if content == b'first':
            paths.write_whole(file, b'second')
        return count

    monkeypatch.setattr(Path, 'write_bytes', written_meanwhile)
    paths.write_whole(file, b'first')
    assert file.read_bytes() == b'first'
    assert list(tmp_path.iterdir()) == [file]


def test_a_written_file_is_on_the_disk_before_it_has_its_name_and_then_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a cut of power soon after may leave an empty file under that name."""
    done: list[str] = []
    sync, replace = os.fsync, Path.replace

    def note_sync(descriptor: int) -> None:
        name = Path(f'/proc/self/fd/{descriptor}').readlink().name
        done.append(f'{name} with {os.fstat(descriptor).st_size}')
        sync(descriptor)

    def note_replace(draft: Path, file: Path) -> Path:
        done.append('named')
        return replace(draft, file)

    monkeypatch.setattr(os, 'fsync', note_sync)
    monkeypatch.setattr(Path, 'replace', note_replace)
    monkeypatch.setattr(paths.secrets, 'token_hex', lambda _: 'abcd')
    (tmp_path / 'models').mkdir()
    paths.write_whole(tmp_path / 'models' / 'gel.safetensors', b'12345')
    folder = f'models with {(tmp_path / "models").stat().st_size}'
    assert done == ['.gel.safetensors.abcd.part with 5', 'named', folder]


def test_a_name_that_is_too_long_is_no_file(tmp_path: Path) -> None:
    assert not paths.is_file(tmp_path / ('x' * 300))


@pytest.mark.parametrize('name', ['bag/bag_0.mcap', 'other/../bag/bag_0.mcap', 'bag', 'link', 'data.npz'])
def test_an_output_in_the_place_of_what_is_read_for_it_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ('bag', 'other'):
        Path(folder).mkdir()
    for file in ('bag/bag_0.mcap', 'data.npz'):
        Path(file).write_text('recorded')
    Path('link').symlink_to('bag/bag_0.mcap')
    with pytest.raises(ConfigurationError, match='cannot write'):
        paths.check_output(Path(name), Path('bag'), Path('data.npz'), None)
    for beside in ('new', 'bag/presses.npz'):
        paths.check_output(Path(beside), Path('bag'), Path('data.npz'), None)
    assert Path('bag/bag_0.mcap').read_text() == 'recorded'
