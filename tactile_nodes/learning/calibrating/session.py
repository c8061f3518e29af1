"""One calibration from the first press to the model in use: the calibrator node without its messages."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import AskedToEndError, ModelError, TactileError
from tactile_nodes.learning.calibrating.calibrator import Calibrator, Fitted, StopRule
from tactile_nodes.learning.calibrating.files import Source
from tactile_nodes.learning.calibrating.listing import listed
from tactile_nodes.learning.calibrating.live_model import LiveModel
from tactile_nodes.learning.calibrating.presses import Presses, finish, new_file, take_presses, write_calibration
from tactile_nodes.learning.field.calibration import pressed_by
from tactile_nodes.learning.recorded.building import gel_entry
from tactile_nodes.learning.transfer.fit import Transfer
from tactile_nodes.messages import types
from tactile_nodes.model_file import check_model_output
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.ready_model import Inputs


@dataclass(frozen=True)
class CalibrationSettings:
    """Settings: what is calibrated, from which presses, and when it ends."""

    READ_ONLY: ClassVar[bool] = True

    model: str = parameter('portable', 'source model: name of a shipped one, or a file')
    gel: str = parameter('', 'name of the new gel, or the YAML file of a simulated one')
    body: str = parameter('', 'body that presses, like punch:1.5, for a model of any contact; empty: as in the model')
    folder: str = parameter('calibration', 'folder for calibrations, each in a separate file')
    output: str = parameter('', 'file to write instead; an existing one is replaced')
    bag: str = parameter('', 'bag to take presses from; empty: the running rig')
    rig: str = parameter('rig', 'node that presses')
    rig_end: str = parameter('stop', 'command to the rig at the end', choices=('stop', 'pause'))
    estimator: str = parameter('force_estimator', 'node that uses the calibration; empty: none')
    stay: bool = parameter(False, 'keep node and launch running after the end', read_only=False)
    rule: StopRule = field(default_factory=StopRule)


class CalibrationSession:
    """Takes presses until more do not pay, writes the calibration, and lets the estimator load it.

    Args:
        settings: as above.
        tell: receives the text for a person, a line at a time.

    `ended`: whether `end` was called.

    Raises:
        ModelError, ConfigurationError: there is no such model, gel or body, the model cannot be calibrated, or the file
            cannot be written. This is checked before anything is pressed.
    """

    def __init__(self, settings: CalibrationSettings, tell: Callable[[str], None]) -> None:
        self._settings, self._tell, self.ended = settings, tell, False
        self._source = Source.find(settings.model)
        check_model_output(self._file(), self._source.file)
        pressed = pressed_by(self._source.loaded, body=settings.body)
        self.calibrator = Calibrator(self._source.loaded, gel_entry(settings.gel), settings.rule, pressed=pressed)
        self._begun_ns = perf_ns()

    def run(self, presses: Presses, live: LiveModel | None) -> Path:
        """Run the session once; returns the file that was written. The rig is asked to end in any case.

        Raises:
            DatasetError: no calibration follows from the presses; says why.
            ModelError: the images or the running sensor's features do not fit the model.
            BusError: the running force estimator does not answer.
            AskedToEndError: `end` was called before the model was written.
        """
        try:
            take_presses(self.calibrator, presses, self._tell_while_wanted)
            self._require_wanted()
            calibration = finish(self.calibrator, presses, self._tell)
            self._require_wanted()
        finally:
            presses.stop()
            presses.close()
            self.calibrator.close()
        file = self._file()
        model_id, written = write_calibration(
            self._source, self.calibrator, file, begun_ns=self._begun_ns, command='tactile launch calibrate',
            replaces=self._replaced(live, file),
        )  # fmt: skip
        self._tell(f'{file}: model {model_id}, from {calibration.presses} presses')
        self._tell(_summary(calibration))
        if written.field:
            self._tell(f'force field {written.field}')
        self._tell(listed(file))
        if live is not None and live.present:
            live.use(file)
            self._tell('the force estimator uses it now; to return to the model before: its service ~/undo_calibration')
        else:
            self._tell(f'no force estimator is running; to use it: tactile launch live model:={shlex.quote(str(file))}')
        return file

    def end(self) -> None:
        """`run` is to end, from any thread: after the press or the fit under way, unless the model is written."""
        self.ended = True

    @property
    def values(self) -> dict[str, object]:
        """Progress in numbers for /diagnostics: held-out medians in N and mm, NaN before the first fit."""
        calibrator = self.calibrator
        last = calibrator.fits[-1] if calibrator.fits else Fitted(0, math.nan, math.nan)
        return {
            'presses': calibrator.presses, 'most': calibrator.rule.most, 'force_error_n': last.force_n,
            'place_error_mm': last.place_mm, 'objection': calibrator.objection,
        }  # fmt: skip

    def require_features(self, message: types.FlowFeatures) -> None:
        """Refuse a sensor that measures other features than the model reads, before anything is pressed for it.

        Raises:
            ModelError: says both.
        """
        needed, found = Inputs.of_model(self._source.loaded), Inputs.of_message(message)
        if needed != found:
            raise ModelError(
                f'model {self._settings.model} needs other features than the running sensor publishes: '
                f'{needed.unlike(found)}; start the sensor with that model, or calibrate one that reads its features'
            )

    def _tell_while_wanted(self, text: str) -> None:
        self._require_wanted()
        self._tell(text)

    def _require_wanted(self) -> None:
        if self.ended:
            raise AskedToEndError(f'asked to end after {self.calibrator.presses} presses; no model was written')

    def _replaced(self, live: LiveModel | None, file: Path) -> dict[str, str] | None:
        """The card's entry for the model in use; None if unknown, because an error would lose the presses."""
        if live is None or not live.present:
            return None
        try:
            return live.in_use(file)
        except TactileError as error:
            self._tell(f'the calibration does not name the model that it replaces: {error}')
            return None

    def _file(self) -> Path:
        settings = self._settings
        if settings.output:
            return Path(settings.output)
        name = Path(settings.gel).stem if settings.gel.endswith(('.yaml', '.yml')) else settings.gel
        return new_file(Path(settings.folder), name)


def _summary(calibration: Transfer) -> str:
    before, after = calibration.before, calibration.after
    return (
        f'force RMSE {1e3 * before.force_rmse_n:.1f} mN before, {1e3 * after.force_rmse_n:.1f} mN after; place '
        f'{before.place_median_mm:.3f} mm before, {after.place_median_mm:.3f} mm after (medians; presses held out)'
    )
