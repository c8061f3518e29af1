"""From presses as they come to a calibration: reported press by press, until more do not pay, written to a file.

The same code serves bags (the command, and the node that replays one) and a running rig (the node).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from tactile_nodes.clock import NS_PER_S, perf_ns
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.calibrating.calibrator import Calibrator, PressRead, Reading, curves
from tactile_nodes.learning.calibrating.files import Source, completed, write
from tactile_nodes.learning.recorded.bags import RecordedPress, open_bags
from tactile_nodes.learning.recorded.building import card_entry
from tactile_nodes.learning.transfer.fit import Transfer

Tell = Callable[[str], None]


@runtime_checkable
class Presses(Protocol):
    """A source of presses; `bags` are the files, if there are any.

    `waiting` says whether the next press is available, `rest_counts` whether those after `stop` are used, since they
    cost nothing.
    """

    bags: Sequence[Path]
    rest_counts: bool

    @property
    def waiting(self) -> bool: ...

    def __iter__(self) -> Iterator[tuple[int, RecordedPress]]:
        """Each press with the number of its bag, from 0; a new iteration continues with the next press."""
        ...

    def card_entries(self, gel: str) -> list[dict[str, Any]]:
        """The card's entry for each bag; its id is right once all presses were taken."""
        ...

    def stop(self) -> None:
        """No more presses are needed; those that are under way still come."""
        ...

    def close(self) -> None:
        """Close what is open."""
        ...


class BagPresses:
    """The presses of some bags, one bag after the other. Raises what `open_bags` raises."""

    rest_counts = False
    waiting = False

    def __init__(self, bags: Sequence[Path], namespace: str | None = None, tell: Tell = lambda _: None) -> None:
        with ExitStack() as stack:
            self._opened = open_bags(bags, stack, tell, namespace)
            self._closing = stack.pop_all()
        self.bags: Sequence[Path] = [bag.path for bag in self._opened]
        self._stream = self._presses(tell)

    def __iter__(self) -> Iterator[tuple[int, RecordedPress]]:
        return self._stream

    def _presses(self, tell: Tell) -> Iterator[tuple[int, RecordedPress]]:
        for number, bag in enumerate(self._opened):
            for press in bag.presses():
                yield number, press
            for problem in bag.problems:  # some show only while the bag is read
                tell(f'{bag.path}: {problem.removeprefix(f"{bag.path}: ")}')

    @property
    def count(self) -> int:
        """The number of attempts in the bags."""
        return sum(bag.press_count for bag in self._opened)

    def card_entries(self, gel: str) -> list[dict[str, Any]]:
        return [card_entry(bag, gel) for bag in self._opened]

    def stop(self) -> None:
        """Does nothing: a bag has no rig to stop."""

    def close(self) -> None:
        """Close the bags' files."""
        self._closing.close()


def take_presses(
    calibrator: Calibrator, presses: Presses, tell: Tell, *, along: bool = True, command: str = ''
) -> None:
    """Take presses until none is left or, with `along`, until more do not pay; the fit is then renewed in between.

    Raises:
        DatasetError, ModelError: a press that shows another gel, or whose images the model cannot read.
    """
    for bag, press in presses:
        read = calibrator.take(press, bag)
        tell(press_line(read) if read else f'left out: {calibrator.left_out}')
        if along and read and calibrator.due and not presses.waiting:
            calibrator.fit(presses.card_entries(str(calibrator.gel['id'])), presses.bags, command)
            tell(fit_line(calibrator))
        if along and (reason := calibrator.enough):
            tell(f'no more presses: {reason}')
            presses.stop()
            break
    for bag, press in presses:  # all of them, since a bag's id follows from its whole content
        if presses.rest_counts and (read := calibrator.take(press, bag)):
            tell(press_line(read))


def finish(calibrator: Calibrator, presses: Presses, tell: Tell, command: str = '') -> Transfer:
    """The calibration by all presses.

    Raises:
        DatasetError: none follows from them; says why.
    """
    before = calibrator.calibration
    calibrator.fit(presses.card_entries(str(calibrator.gel['id'])), presses.bags, command)
    calibrator.require_live_gel()
    if calibrator.presses and (left_out := calibrator.all_left_out):
        tell(f'left out: {left_out}')
    if calibrator.calibration is None:
        raise DatasetError(calibrator.objection)
    if calibrator.calibration is not before:  # otherwise the last line was this one
        tell(fit_line(calibrator))
    return calibrator.calibration


def write_calibration(
    source: Source,
    calibrator: Calibrator,
    output: Path,
    *,
    begun_ns: int,
    command: str,
    replaces: Mapping[str, str] | None = None,
) -> tuple[str, Transfer]:
    """Write the calibration that was begun at a time of `perf_ns` as a model file; its id, and what was written.

    Raises:
        DatasetError: by the presses the camera differs from its description.
    """
    calibration, recordings = calibrator.calibration, calibrator.recordings
    assert calibration is not None
    assert recordings is not None
    seconds = round((perf_ns() - begun_ns) / NS_PER_S, 1)
    source, calibration = completed(
        source, recordings, calibration, calibrator.progress, calibrator.pressed,
        forced=calibrator.forced, curve=calibrator.curve,
    )  # fmt: skip
    model_id = write(source, recordings, calibration, output, seconds=seconds, command=command, replaces=replaces)
    return model_id, calibration


def new_file(folder: Path, gel: str) -> Path:
    """A new file name (gel-7_01, gel-7_02): every calibration is kept, so that undo finds the one before."""
    name = ''.join(letter if letter.isalnum() or letter in '-_' else '-' for letter in gel) or 'gel'
    taken = {each.stem for each in folder.glob(f'{name}_*.safetensors')}
    number = next(number for number in range(1, len(taken) + 2) if f'{name}_{number:02d}' not in taken)
    return folder / f'{name}_{number:02d}.safetensors'


def press_line(read: PressRead) -> str:
    """'press 17, 0.412 N: 3.1 mN and 0.05 mm off; without calibration 61.0 mN and 0.93 mm'"""
    before = _off(read.before)
    text = f'without calibration {before}' if read.after is None else f'{_off(read.after)} off; without {before}'
    return f'press {read.number}, {read.force_n:.3f} N: {text}'


def fit_line(calibrator: Calibrator) -> str:
    """'25 presses: 3.1 mN and 0.052 mm off where held out (medians) …', or why there is no calibration yet."""
    calibration = calibrator.calibration
    if calibration is None:
        return f'after press {calibrator.presses}: no calibration yet: {calibrator.objection}'
    text = f'{calibrator.presses} presses: {_medians(calibration.after)} off on held-out presses, without calibration '
    text += f'{_medians(calibration.before)} (medians); form {calibration.form}'
    if mounting := getattr(calibration, 'mounting', ''):
        text += f'; {mounting}'
    if found := curves(calibrator.fits):
        twice = 2 * calibrator.presses
        force, place = (curve.at(twice) for curve in found)
        text += f'; with {twice} about {1e3 * force:.1f} mN and {place:.3f} mm'
    return text


def _off(reading: Reading) -> str:
    return f'{1e3 * abs(reading.off_n):.1f} mN and {reading.off_mm:.2f} mm'


def _medians(errors: Any) -> str:
    return f'{1e3 * errors.force_median_n:.1f} mN and {errors.place_median_mm:.3f} mm'
