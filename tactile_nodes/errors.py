"""All errors that this package raises on purpose.

The text of each is one sentence for a person: what was attempted on what, and what to do.
Foreign errors are translated where they occur (``raise DeviceLostError(...) from error``). A program therefore catches
`TactileError`, prints the sentence, and exits with status 1, or with `NOT_AGAIN`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NOT_AGAIN = 3
"""Exit status of a program that needs a person's help; a launch that needs the program ends with it."""


class TactileError(Exception):
    """The base class of all errors."""


class ConfigurationError(TactileError):
    """A YAML block, parameter or argument that cannot be used."""

    @classmethod
    def at(cls, source: str | Path, line: int | None, text: str) -> ConfigurationError:
        """An error that names its place in the form that editors and terminals link: ``file:line: text``."""
        return cls(f'{source}:{line}: {text}' if line is not None else f'{source}: {text}')


class LaunchFileError(ConfigurationError):
    """A launch file that cannot be used."""


class AskedToEndError(TactileError):
    """The process must end while some of its work still waits."""


class DeviceError(TactileError):
    """A device that does not work as it should."""


class DeviceNotFoundError(DeviceError):
    """There is no device to open."""


class DeviceBusyError(DeviceError):
    """Another program uses the device."""


class DeviceLostError(DeviceError):
    """The device was there, but is gone."""


class DeviceTimeoutError(DeviceError):
    """The device is there, but does not respond in time."""


class DeviceFaultError(DeviceError):
    """The device reports a fault: an alarm, a refused command, a status bit."""


class ImageError(TactileError):
    """An image of the wrong size or encoding, or without pixels."""


class MessageError(TactileError):
    """Bytes that are not a message of the announced type, or a type that does not exist."""


class BusError(TactileError):
    """The bus cannot do what was requested."""


class AddressInUseError(BusError):
    """Another process uses the address."""


class ServiceError(BusError):
    """A service call without a response."""


class ServiceUnavailableError(ServiceError):
    """No node offers the service."""


class ServiceTimeoutError(ServiceError):
    """A node offers the service, but does not respond in time."""


class BagError(TactileError):
    """A recording that cannot be written or read."""


class DatasetError(TactileError):
    """A data set of presses that is missing, damaged, or unfit for its use."""


class NoPressesError(DatasetError):
    """A bag has no topic of presses, or none of their images."""


class TooFewPressesError(DatasetError):
    """Too few presses, or too few images of the untouched gel, to learn from."""


class ModelError(TactileError):
    """A model file that is missing, damaged, foreign, or made for other inputs."""


def in_a_line(error: object) -> str:
    """The text of an error, without its line breaks."""
    return ' '.join(str(error).split())


@contextmanager
def from_extra(extra: str, feature: str) -> Iterator[None]:
    """A context for imports of libraries of one optional extra; `feature` is what needs them.

    Raises:
        ConfigurationError: one is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise ConfigurationError(
            f"{feature} needs a library ({in_a_line(error)}); install it with: pip install 'tactile_nodes[{extra}]'"
        ) from error
