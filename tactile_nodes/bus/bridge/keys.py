"""Keys by which machines know each other: a pair of files a machine, the secret one for its user's eyes alone."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import zmq

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_plain

_KEY = re.compile(r'[0-9A-Za-z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}')  # 32 bytes in Z85 (ZeroMQ RFC 32)
_NAME = re.compile(r'[\w.-]+', re.ASCII)


@dataclass(frozen=True)
class KeyPair:
    """A machine's public and secret CURVE key, in Z85."""

    public: bytes
    secret: bytes = field(repr=False)


def keys_directory() -> Path:
    """Where keys are kept: ``$TACTILE_KEYS``, else ``$XDG_CONFIG_HOME/tactile_nodes/keys``, else ``~/.config/…``."""
    if chosen := os.environ.get('TACTILE_KEYS'):
        return Path(chosen).expanduser()
    return Path(os.environ.get('XDG_CONFIG_HOME', Path.home() / '.config')) / 'tactile_nodes' / 'keys'


def create_keys(name: str, folder: Path | None = None) -> tuple[Path, Path]:
    """Make a pair of keys; the files of the public and of the secret one.

    Raises:
        ConfigurationError: there are keys of that name, or they cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(f'{name!r} cannot be the name of keys: letters, digits, dots, dashes and _ only')
    folder = folder or keys_directory()
    public, secret = folder / f'{name}.key', folder / f'{name}.key_secret'
    pair = zmq.curve_keypair()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if public.exists():  # the secret one is not opened if it exists; this one must not be orphaned either
            raise FileExistsError(17, os.strerror(17), str(public))
        for file, lines in ((secret, pair), (public, pair[:1])):
            descriptor = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            with os.fdopen(descriptor, 'wb') as opened:
                opened.write(b'\n'.join(lines) + b'\n')
    except FileExistsError as error:
        raise ConfigurationError(
            f'there are keys named {name!r} in {folder}; remove them first, or choose another name'
        ) from error
    except OSError as error:
        raise ConfigurationError(f'cannot write keys to {folder}: {error.strerror}') from error
    return public, secret


def read_pair(name: str) -> KeyPair:
    """A machine's own keys, by name or by the path of the secret file.

    Raises:
        ConfigurationError: there are none, others may read them, or the file holds something else.
    """
    file = _file(name, '.key_secret')
    lines = _lines(file, 'make them with: tactile keys create NAME')
    if len(lines) != 2:
        raise ConfigurationError(f'{file} holds no pair of keys; make one with: tactile keys create NAME')
    if file.stat().st_mode & 0o077:
        raise ConfigurationError(f'others may read the secret key {file}; forbid it with: chmod 600 {file}')
    return KeyPair(*lines)


def read_public(name: str) -> bytes:
    """Another machine's public key: the key itself, the name of its file in the folder of keys, or its path.

    Raises:
        ConfigurationError: no such key.
    """
    if _KEY.fullmatch(name):
        return name.encode()
    file = _file(name, '.key')
    lines = _lines(file, f'copy the public key that "tactile keys show" prints on the other machine to {file}')
    if len(lines) != 1:
        raise ConfigurationError(f'{file} holds no public key alone; the secret one must not leave its machine')
    return lines[0]


def _file(name: str, ending: str) -> Path:
    return Path(name).expanduser() if '/' in name else keys_directory() / f'{name}{ending}'


def _lines(file: Path, advice: str) -> list[bytes]:
    try:
        lines = read_plain(file, 4096).decode('ascii').split()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'cannot read the key {file}; {advice}') from error
    if not all(map(_KEY.fullmatch, lines)):
        raise ConfigurationError(f'{file} holds no key; {advice}')
    return [line.encode() for line in lines]
