"""Keys by which machines know each other: a pair of files a machine, the secret one for its user's eyes alone.

The secret file holds a private key and the certificate that belongs to it, the public one the certificate alone (PEM).
Certificates are signed by their own keys: who may connect is said by name, not by an authority. They do not expire,
and are valid from 1970 on, since a robot's clock may be wrong.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError, from_extra
from tactile_nodes.files import read_plain

_NAME = re.compile(r'[\w.-]{1,64}', re.ASCII)
_PART = re.compile(rb'-----BEGIN ([A-Z ]+)-----\n[A-Za-z0-9+/=\n]+-----END \1-----\n')
_SECRET, _PUBLIC = b'PRIVATE KEY', b'CERTIFICATE'
_FOREVER = (datetime(1970, 1, 1), datetime(9999, 12, 31))  # UTC (RFC 5280, 4.1.2.5)


@dataclass(frozen=True)
class KeyPair:
    """A machine's certificate and private key, in PEM."""

    public: bytes
    secret: bytes = field(repr=False)


def keys_directory() -> Path:
    """Where keys are kept: ``$TACTILE_KEYS``, else ``$XDG_CONFIG_HOME/tactile_nodes/keys``, else ``~/.config/…``."""
    chosen = os.environ.get('TACTILE_KEYS')
    return Path(chosen or paths.of_user('XDG_CONFIG_HOME', '.config') / paths.PACKAGE / 'keys').expanduser()


def create_keys(name: str, folder: Path | None = None) -> tuple[Path, Path]:
    """Make a pair of keys; the files of the public and of the secret one.

    Raises:
        ConfigurationError: there are keys of that name, they cannot be written, or what makes them is not installed.
    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(f'{name!r} is not a valid key name: use up to 64 letters, digits, dots, dashes and _')
    folder = folder or keys_directory()
    public, secret = folder / f'{name}.key', folder / f'{name}.key_secret'
    pair = _make_pair(name)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if public.exists():  # the secret one is not opened if it exists; this one must not be orphaned either
            raise FileExistsError(17, os.strerror(17), str(public))
        for file, text in ((secret, pair.secret + pair.public), (public, pair.public)):
            descriptor = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            with os.fdopen(descriptor, 'wb') as opened:
                opened.write(text)
    except FileExistsError as error:
        raise ConfigurationError(
            f'keys named {name!r} already exist in {folder}; remove them first, or choose another name'
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
    parts = _parts(file, 'create them with: tactile keys create NAME')
    if list(parts) != [_SECRET, _PUBLIC]:
        raise ConfigurationError(f'{file} does not contain a key pair; create one with: tactile keys create NAME')
    if file.stat().st_mode & 0o077:
        raise ConfigurationError(f'the secret key {file} is readable by others; fix it with: chmod 600 {file}')
    return KeyPair(parts[_PUBLIC], parts[_SECRET])


def read_public(name: str) -> bytes:
    """Another machine's certificate, by the name of its file in the folder of keys, or by its path.

    Raises:
        ConfigurationError: no such key.
    """
    file = _file(name, '.key')
    parts = _parts(file, f'write the output of "tactile keys show NAME" on the other machine to {file}')
    if list(parts) != [_PUBLIC]:
        raise ConfigurationError(
            f'{file} does not contain only a public key; the secret key must not leave its machine'
        )
    return parts[_PUBLIC]


def fingerprint(public: bytes) -> str:
    """A certificate's SHA-256 fingerprint, as ``openssl x509 -fingerprint -sha256`` tells it, without the colons.

    Raises:
        ConfigurationError: it is damaged.
    """
    import ssl
    from hashlib import sha256

    try:
        return sha256(ssl.PEM_cert_to_DER_cert(public.decode())).hexdigest()
    except ValueError as error:
        raise ConfigurationError(f'the certificate is damaged ({error})') from error


def _make_pair(name: str) -> KeyPair:
    with from_extra('bridge', 'making keys'):
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    key = ec.generate_private_key(ec.SECP256R1())
    who = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(who)
        .issuer_name(who)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(_FOREVER[0])
        .not_valid_after(_FOREVER[1])
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    plain = serialization.NoEncryption()
    return KeyPair(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain),
    )


def _file(name: str, ending: str) -> Path:
    return Path(name).expanduser() if '/' in name else keys_directory() / f'{name}{ending}'


def _parts(file: Path, advice: str) -> dict[bytes, bytes]:
    """The parts of a PEM file by their labels, in their order."""
    try:
        text = read_plain(file, 16384)
    except OSError as error:
        raise ConfigurationError(f'cannot read the key {file}; {advice}') from error
    parts = {match[1]: match[0] for match in _PART.finditer(text)}
    if not parts:
        raise ConfigurationError(
            f'{file} contains no key (keys made before 0.2.0 are not valid: create new ones on each machine); {advice}'
        )
    return parts
