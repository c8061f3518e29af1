"""Damaged files: a bag truncated at every byte, and a model file with one changed byte at many places."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.errors import TactileError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types
from tactile_nodes.model_file import find_model, load_model

MESSAGES = 12
STEP_NS = 10_000_000
FIRST_NS = 1_700_000_000_000_000_000
HEAD_BYTES = 64


@dataclass
class Damaged:
    """The results with damaged files.

    Attributes:
        tried: number of files.
        outcomes: how often a file was read, wholly or in part, or refused in one sentence.
        wrong: failures, as text: another exception, a message that was not written, a reason with several lines.
    """

    what: str
    tried: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        return {'what': self.what, 'tried': self.tried, 'outcomes': dict(self.outcomes), 'wrong': self.wrong[:10]}


def bag_cuts(folder: Path, progress: Progress, every: int = 1) -> list[dict[str, Any]]:
    """Read a small bag, plain and compressed, truncated after each byte."""
    return [_cuts(folder, compression, every, progress).summary() for compression in ('none', 'zstd')]


def _cuts(folder: Path, compression: str, every: int, progress: Progress) -> Damaged:
    whole = _small_bag(folder / f'bag_{compression}', compression)
    data, cut = whole.read_bytes(), folder / f'cut_{compression}.mcap'
    with BagReader(whole) as reader:
        written = [bytes(message.data) for message in reader.messages()]
    found = Damaged(f'a bag of {len(data)} bytes, compression {compression}')
    with progress.bar(f'bag cut, {compression}', len(range(0, len(data), every))) as bar:
        for size in range(0, len(data), every):
            cut.write_bytes(data[:size])
            found.tried += 1
            try:
                with BagReader(cut) as reader:
                    read = [bytes(message.data) for message in reader.messages()]
                if read != written[: len(read)]:
                    found.wrong.append(f'cut at {size}: messages that were not written')
                found.outcomes['read up to the cut' if read else 'read, no message in it yet'] += 1
            except TactileError as error:
                _refused(found, error, f'cut at {size}')
            except Exception as error:  # noqa: BLE001 - any other exception is a failure
                found.wrong.append(f'cut at {size}: {error!r}')
            bar.advance()
    return found


def model_bytes(folder: Path, name: str, count: int, progress: Progress, seed: int = 1) -> dict[str, Any]:
    """Load a shipped model file with one changed byte: the first bytes in turn, then random ones, `count` in all."""
    file = find_model(name)
    data, altered = file.read_bytes(), folder / 'altered.safetensors'
    chance = random.Random(seed)  # noqa: S311 - places, not secrets
    places = [*range(min(HEAD_BYTES, count)), *(chance.randrange(len(data)) for _ in range(count - HEAD_BYTES))]
    found = Damaged(f'model {name}, {len(data)} bytes')
    with progress.bar(f'model {name} altered', len(places)) as bar:
        for place in places:
            flip = chance.randrange(1, 256)
            altered.write_bytes(data[:place] + bytes([data[place] ^ flip]) + data[place + 1 :])
            found.tried += 1
            try:
                load_model(altered)
                found.wrong.append(f'byte {place} altered by {flip}: taken')
            except TactileError as error:
                _refused(found, error, f'byte {place} altered by {flip}')
            except Exception as error:  # noqa: BLE001 - any other exception is a failure
                found.wrong.append(f'byte {place} altered by {flip}: {error!r}')
            bar.advance()
    return found.summary()


def _refused(found: Damaged, error: TactileError, where: str) -> None:
    found.outcomes['refused in one sentence'] += 1
    if '\n' in str(error) or not str(error):
        found.wrong.append(f'{where}: {error!r}')


def _small_bag(folder: Path, compression: str) -> Path:
    writer = BagWriter(folder, compression=compression)
    writer.add_topic(BagTopic.of_type('/wrench', 'geometry_msgs/msg/WrenchStamped'))
    for number, data in enumerate(_wrenches()):
        at_ns = FIRST_NS + number * STEP_NS
        writer.write('/wrench', data, at_ns, at_ns, number)
    writer.close()
    return next(folder.glob('*.mcap'))


def _wrenches() -> Iterable[bytes]:
    for number in range(MESSAGES):
        force = types.Vector3(z=-0.1 * number)
        yield messages.encode(types.WrenchStamped(wrench=types.Wrench(force=force)))
