"""Add a calibration to the list of the lab's gels."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactile_nodes.clock import wall_ns
from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.gel_list import Calibration, GelList
from tactile_nodes.learning.calibrating.files import CALIBRATION
from tactile_nodes.model_file import load_model


def calibration_of(file: Path, *, sensor: str = '', made_ns: int = 0) -> Calibration:
    """The calibration, or the training on recorded presses, as the card of a model file describes it.

    Raises:
        ModelError: there is no such file, or it follows from no press on a real gel.
    """
    loaded = load_model(file)
    if _mapping(loaded.card.get('data')).get('origin') not in {CALIBRATION, 'recorded'}:
        raise ModelError(f'{file} was not calibrated with presses on a gel of this lab; use: tactile calibrate')
    calibration = _mapping(_mapping(loaded.card.get('training')).get('calibration'))
    error_n = _mapping(calibration.get('after')).get('force_rmse_n')
    presses = calibration.get('presses', loaded.card['data'].get('presses'))
    return Calibration(
        loaded.model_id, loaded.gel, sensor, str(file.resolve()),
        source=str(_mapping(loaded.card.get('source')).get('model', '')),
        made_ns=made_ns,
        presses=presses if isinstance(presses, int) else 0,
        error_n=float(error_n) if isinstance(error_n, int | float) else None,
    )  # fmt: skip


def listed(file: Path, sensor: str = '') -> str:
    """Add a new calibration to the list; returns the message for the person, also on failure."""
    gels = GelList()
    try:
        gels.add(calibration_of(file, sensor=sensor, made_ns=wall_ns()))
    except (ConfigurationError, ModelError) as error:
        return f'not in the list of gels: {error}'
    return f'in the list of gels ({gels.file}); see: tactile gels'


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
