"""Every error that this package raises on purpose.

::

    TactileError
    ├── ConfigurationError          a YAML block, parameter or argument that cannot be used
    │   └── LaunchFileError         the same, in a launch file
    ├── DeviceError
    │   ├── DeviceNotFoundError     nothing there to open
    │   ├── DeviceBusyError         another program has it
    │   ├── DeviceLostError         it was there, and is not any more
    │   ├── DeviceTimeoutError      it is there, and does not answer
    │   └── DeviceFaultError        it answers that something is wrong: an alarm, a refused command, a status bit
    ├── ImageError                  an image of the wrong size or encoding, or without a picture in it
    ├── MessageError                bytes that are no message of the announced type
    ├── BusError
    │   ├── AddressInUseError       somebody else listens there
    │   └── ServiceError
    │       ├── ServiceUnavailableError   nobody serves it
    │       └── ServiceTimeoutError       somebody serves it, and does not answer
    ├── BagError                    a recording that cannot be written or read
    ├── AskedToEndError             the process is to end, while something in it still waits
    ├── DatasetError                presses that cannot be learned from: a data set that is missing, damaged or unfit
    │   └── TooFewPressesError      presses, or images of the untouched gel, that are too few
    └── ModelError                  a model file that is missing, damaged, foreign or made for other inputs

The text of each is one sentence for a person: what was attempted on what, and what to do.
Foreign errors are translated at the edge (``raise DeviceLostError(...) from error``), so that
whoever starts a program catches `TactileError`, prints the sentence, and exits with status 1, or with `NOT_AGAIN`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NOT_AGAIN = 3
"""Exit status of a program that only a person can set right; a launch does not start it again."""


class TactileError(Exception):
    """The root of the tree."""


class ConfigurationError(TactileError):
    """A YAML block, parameter or argument that cannot be used."""

    @classmethod
    def at(cls, source: str | Path, line: int | None, text: str) -> ConfigurationError:
        """An error that names its place, in the form editors and terminals link: ``file:line: text``."""
        return cls(f'{source}:{line}: {text}' if line is not None else f'{source}: {text}')


class LaunchFileError(ConfigurationError):
    """A launch file that cannot be used."""


class AskedToEndError(TactileError):
    """The process is to end, while something in it still waits."""


class DeviceError(TactileError):
    """A device that does not do what it should."""


class DeviceNotFoundError(DeviceError):
    """Nothing there to open."""


class DeviceBusyError(DeviceError):
    """Another program has it."""


class DeviceLostError(DeviceError):
    """It was there, and is not any more."""


class DeviceTimeoutError(DeviceError):
    """It is there, and does not answer in time."""


class DeviceFaultError(DeviceError):
    """It answers that something is wrong: an alarm, a refused command, a status bit."""


class ImageError(TactileError):
    """An image of the wrong size or encoding, or without a picture in it."""


class MessageError(TactileError):
    """Bytes that are no message of the announced type, or a type that does not exist."""


class BusError(TactileError):
    """The bus cannot do what was asked of it."""


class AddressInUseError(BusError):
    """Somebody else listens at that address."""


class ServiceError(BusError):
    """A service call that brought no answer."""


class ServiceUnavailableError(ServiceError):
    """Nobody serves it."""


class ServiceTimeoutError(ServiceError):
    """Somebody serves it, and does not answer in time."""


class BagError(TactileError):
    """A recording that cannot be written or read."""


class DatasetError(TactileError):
    """A data set of presses that is missing, damaged, or does not fit what is to be done with it."""


class TooFewPressesError(DatasetError):
    """Presses, or images of the untouched gel, that are too few to learn from."""


class ModelError(TactileError):
    """A model file that is missing, damaged, foreign, or made for other inputs."""


def in_a_line(error: object) -> str:
    """What an error says, without its line breaks."""
    return ' '.join(str(error).split())


@contextmanager
def from_extra(extra: str, what: str) -> Iterator[None]:
    """For imports of libraries that come with an extra of this package alone; `what` is done with them.

    Raises:
        ConfigurationError: one is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise ConfigurationError(
            f"{what} needs a library ({in_a_line(error)}); install it with: pip install 'tactile_nodes[{extra}]'"
        ) from error
