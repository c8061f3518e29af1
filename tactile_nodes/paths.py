"""Paths on this machine: the data files of the package, and the folders that it may write to."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
import tempfile
from functools import cache
from pathlib import Path

from tactile_nodes.errors import ConfigurationError

PACKAGE = 'tactile_nodes'
OF_BAGS = frozenset({'.mcap', '.db3', '.yaml'})
OF_PICTURES = frozenset({'.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp'})
_LOGINS = '/run/user'
_LONGEST_SOCKET_PATH = 107  # bytes: sockaddr_un.sun_path holds 108, the last one a NUL, see unix(7)
_LONGEST_SOCKET_NAME = 'd232/01234567.99999.sock'  # of the bus, see `bus.zeromq.discovery`


@cache
def share_directory() -> Path:
    """The folder that holds package.xml, msg/, launch/, config/ and models/.

    In a source tree it is the root; after ``pip install`` or a colcon build it is ``<prefix>/share/tactile_nodes``.
    Both are found in the parent folders of this file, so no environment variable is needed, and a virtual environment
    works as an ament prefix.

    Raises:
        ConfigurationError: the package was installed without its data files.
    """
    here = Path(__file__).resolve().parent
    for folder in here.parents:
        for candidate in (folder / 'share' / PACKAGE, folder):
            if (candidate / 'package.xml').is_file() and (candidate / 'msg').is_dir():
                return candidate
    raise ConfigurationError(
        f'{PACKAGE} at {here} was installed without its share folder (msg/, launch/, config/, models/); '
        'install it again with: pip install --force-reinstall tactile_nodes'
    )


def described_in(folder: str, name: Path | str, what: str) -> Path:
    """The YAML file of what ships in a folder of config/, by its name ('speckle_membrane'), or a file by its path.

    Paths of the share folder, as the documents name them (config/train/paper.yaml), are found from everywhere.

    Raises:
        ConfigurationError: there is neither; names those that ship.
    """
    shipped = share_directory() / 'config' / folder
    for file in (shipped / f'{name}.yaml', Path(name), share_directory() / name):
        if is_file(file):
            return file
    names = ', '.join(sorted(each.stem for each in shipped.glob('*.yaml')))
    raise ConfigurationError(f'there is no {what} {str(name)!r}; give a YAML file, or a shipped one: {names}')


def run_directory() -> Path:
    """The folder for sockets and other files that last as long as the processes; only this user may enter.

    ``$TACTILE_RUN_DIR``, else ``tactile`` in ``$XDG_RUNTIME_DIR`` or in ``/run/user/<uid>``, which is the same for a
    login and not named to a system service, else ``<tmp>/tactile-<uid>``.

    Raises:
        ConfigurationError: the folder belongs to another user, or others may enter it.
    """
    return _private(run_directories()[0])


def run_directories() -> list[Path]:
    """The folder that `run_directory` names now, and those that it names after the last logout."""
    if chosen := os.environ.get('TACTILE_RUN_DIR'):
        return [Path(chosen).expanduser().absolute()]
    bases = (os.environ.get('XDG_RUNTIME_DIR'), f'{_LOGINS}/{os.getuid()}')
    logins = [Path(base) / 'tactile' for base in bases if base and _is_own(Path(base))]
    return [*logins, Path(tempfile.gettempdir()) / f'tactile-{os.getuid()}']


def is_short_enough(folder: Path) -> bool:
    """Whether a run folder leaves room for the names of the bus's sockets."""
    return len(os.fsencode(folder / _LONGEST_SOCKET_NAME)) <= _LONGEST_SOCKET_PATH


def log_directory() -> Path:
    """The folder for the output of launched nodes: ``$ROS_LOG_DIR``, else ``~/.ros/log``."""
    return Path(os.environ.get('ROS_LOG_DIR') or of_user('ROS_HOME', '.ros') / 'log')


def cache_directory(*below: str) -> Path:
    """The folder for results that can be computed again: ``$XDG_CACHE_HOME/tactile_nodes``, else ``~/.cache/…``.

    Or one `below` it.

    Raises:
        ConfigurationError: it cannot be created.
    """
    folder = (of_user('XDG_CACHE_HOME', '.cache') / PACKAGE).joinpath(*below)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f'cannot create the cache folder {folder} ({error.strerror}); set XDG_CACHE_HOME to a folder that you own'
        ) from error
    return folder


def state_directory() -> Path:
    """The folder for data that outlive a process: ``$XDG_STATE_HOME/tactile_nodes``, else ``~/.local/state/…``."""
    return of_user('XDG_STATE_HOME', '.local/state') / PACKAGE


def of_user(variable: str, default: str) -> Path:
    """The folder that an environment variable names; if it is unset or empty, one below the home folder.

    Raises:
        ConfigurationError: the variable names none, and the user has no home folder.
    """
    try:
        return Path(os.environ.get(variable) or Path.home() / default)
    except RuntimeError as error:
        raise ConfigurationError(f'this user has no home folder; set HOME or {variable}') from error


def check_output(file: Path, *read: Path | None) -> None:
    """Check that a file can be written under a name, before the work that produces its content.

    An existing file that is not regular, such as a device, is never replaced. Nor are the inputs of the work: files,
    the files that make a folder a bag, and the pictures in a folder.

    Raises:
        ConfigurationError: it cannot be written; the message gives the reason.
    """
    try:
        mode = file.stat().st_mode
        if stat.S_ISDIR(mode):
            raise ConfigurationError(f'cannot write {file}: it is a folder; give the name of a file')
        if not stat.S_ISREG(mode):
            raise ConfigurationError(
                f'cannot write {file}: it is not a regular file and is not replaced; choose another'
            )
    except FileNotFoundError:
        pass  # a new file
    except OSError as error:
        raise ConfigurationError(f'cannot write {file} ({error.strerror}); choose another folder') from error
    place = Path(os.path.realpath(file))
    for source in filter(None, read):
        real = Path(os.path.realpath(source))
        is_of_folder = real in place.parents and place.suffix.lower() in OF_BAGS | OF_PICTURES and place.exists()
        if place == real or is_of_folder:
            raise ConfigurationError(f'cannot write {file}: {source} is read for it; choose another file')
    folder = next(each for each in file.absolute().parents if each.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigurationError(f'cannot write {file}: {folder} is not writable; choose another folder')


def write_whole(file: Path, content: bytes) -> None:
    """Write all of a file or nothing: an existing file stays until all is on the disk. Several processes may write it.

    Raises:
        ConfigurationError: no file can be written there; see `check_output`.
        OSError: writing failed, as on a full disk.
    """
    check_output(file)
    draft = file.with_name(f'.{file.name}.{secrets.token_hex(4)}.part')
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(content)
        flush(draft)
        draft.replace(file)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
    with contextlib.suppress(OSError):  # which some network drives cannot
        flush(file.parent)


def flush(path: Path) -> None:
    """Sync the content of a file, or the names in a folder, to disk, so that a power cut loses nothing.

    Raises:
        OSError: it cannot be synced.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def is_file(path: Path) -> bool:
    """Whether the file exists; false for a name that no file can have, such as one that is too long.

    >>> is_file(Path('x' * 300))
    False
    """
    try:
        return path.is_file()
    except OSError:
        return False


def _is_own(folder: Path) -> bool:
    """Whether this user owns the folder: after ``su`` or ``sudo`` the variable may still name another user's."""
    try:
        return folder.stat().st_uid == os.getuid() and os.access(folder, os.W_OK)
    except OSError:
        return False


def _private(folder: Path) -> Path:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise ConfigurationError(
            f'cannot use {folder} for the sockets of the bus ({error.strerror}); '
            'set TACTILE_RUN_DIR to a folder of your own'
        ) from error
    if not stat.S_ISDIR(found.st_mode):
        raise ConfigurationError(
            f'{folder} is a symbolic link, which others could change; set TACTILE_RUN_DIR to the folder itself'
        )
    if found.st_uid != os.getuid():
        raise ConfigurationError(
            f'{folder} is not owned by user {os.getuid()}; set TACTILE_RUN_DIR to a folder that is'
        )
    if found.st_mode & 0o077:
        raise ConfigurationError(f'{folder} is accessible to others; fix it with: chmod 700 {folder}')
    return folder
