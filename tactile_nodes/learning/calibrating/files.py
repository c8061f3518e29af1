"""Calibrate a model file for another gel: recorded presses on it, the fit, the card, the file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tactile_nodes import __version__, clock
from tactile_nodes.errors import ModelError
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.field.alone import presses_tell_tips, transfer_alone
from tactile_nodes.learning.field.calibration import Pressed, kept, with_field
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.source import require_same_features
from tactile_nodes.learning.transfer.checks import source_readout
from tactile_nodes.learning.transfer.fit import Transfer, transfer
from tactile_nodes.learning.transfer.layer import LayerConfig
from tactile_nodes.learning.transfer.network import NetworkTransfer, transfer_network
from tactile_nodes.model_file import LoadedModel, find_model, load_model, save_model
from tactile_nodes.paths import share_directory
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.network import NetworkReadout

CALIBRATION = 'calibration'

AnyCalibration = Transfer | NetworkTransfer


@dataclass(frozen=True)
class Source:
    """The model that a calibration begins with."""

    file: Path
    loaded: LoadedModel

    @classmethod
    def find(cls, name: str) -> Source:
        """Load a model by its name, if it ships, or by its file. Raises ModelError."""
        file = find_model(name)
        return cls(file, load_model(file))

    def card_entry(self, output: Path) -> dict[str, str]:
        """The card's entry: a model that ships by its name, another by its path relative to the output's folder."""
        ships = self.file.parent == share_directory() / 'models'
        name = self.file.stem if ships else os.path.relpath(self.file.resolve(), output.resolve().parent)
        return {'model': name, 'model_id': self.loaded.model_id, 'gel': self.loaded.gel}


def calibrate(
    source: Source,
    recordings: RecordedPresses,
    output: Path,
    *,
    layer: LayerConfig | None = None,
    progress: Progress | None = None,
    command: str = '',
    forced: bool = False,
    pressed: Pressed | None = None,
    indenter: str = '',
    curve: bool = False,
) -> tuple[str, AnyCalibration]:
    """Write the model of the pressed gel; its id, and how it was found.

    A response is transferred; a network gets the paper's layer, fitted as `layer` says. `forced` as for `transfer`.
    `pressed` is the sensor and body for a readout of any contact, by default those of its source.
    `indenter` names the one whose presses count, if the data set has several; without it a field uses all. `curve` is
    as for `with_field`.

    Raises:
        ModelError: the model cannot be transferred, or reads other features than the data set holds.
        DatasetError: the presses cannot be used, or the calibration would not help.
        ConfigurationError: a layer needs torch, which is not installed.
    """
    begun = clock.perf_ns()
    if indenter or not isinstance(source.loaded.model.readout, FieldReadout):
        recordings = recordings.of_indenter(indenter)
    network = isinstance(source.loaded.model.readout, NetworkReadout)
    if network or layer:
        require_same_features(source.loaded, recordings)
        calibration: AnyCalibration = transfer_network(
            source.loaded, recordings.as_samples(), layer, progress, forced=forced
        )
    else:
        calibration = transferred(source.loaded, recordings, progress, pressed, forced=forced, curve=curve)
        source, calibration = completed(source, recordings, calibration, progress, pressed, forced=forced, curve=curve)
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    return write(source, recordings, calibration, output, seconds=seconds, command=command), calibration


def completed(
    source: Source,
    recordings: RecordedPresses,
    calibration: Transfer,
    progress: Progress | None = None,
    pressed: Pressed | None = None,
    *,
    forced: bool = False,
    curve: bool = False,
) -> tuple[Source, Transfer]:
    """Add the force field if the source has one; also returns the source, with the pressed sensor on its card.

    Raises:
        DatasetError: no press has a force that is known, or by the presses the camera differs from its description.
        ConfigurationError: the body is wider than the gel.
    """
    pressed = pressed or Pressed()
    if not isinstance(source.loaded.model.readout, FieldReadout):
        return source, calibration
    dataset = recordings.as_samples()
    card = pressed.to_card(source.loaded.card, pressed.bodies(source.loaded, dataset))
    loaded = replace(source.loaded, card=card)
    calibration = with_field(source.loaded, calibration, dataset, progress, pressed, forced=forced, curve=curve)
    return replace(source, loaded=loaded), calibration


def transferred(
    loaded: LoadedModel,
    recordings: RecordedPresses,
    progress: Progress | None = None,
    pressed: Pressed | None = None,
    *,
    forced: bool = False,
    curve: bool = False,
) -> Transfer:
    """A model fitted to the presses on another gel; `forced` as for `transfer`, `curve` as for `transfer_alone`.

    Raises:
        ModelError: the model cannot be transferred, or reads other features than the data set holds.
        DatasetError: the presses cannot be used, or the calibration would not help.
    """
    require_source(loaded, str(recordings.card['gel']['id']))
    require_same_features(loaded, recordings)
    pressed = pressed or Pressed()
    dataset = recordings.as_samples()
    if not presses_tell_tips(loaded, pressed, dataset):
        return transfer_alone(loaded, dataset, pressed, progress, forced=forced, curve=curve)
    return transfer(source_readout(loaded), dataset, progress, forced=forced)


def require_source(loaded: LoadedModel, gel: str) -> None:
    """Refuse a model that cannot be calibrated, before anything is pressed.

    Raises:
        ModelError: it cannot be transferred, or is a calibration for this very gel; says which model to begin with.
    """
    readout = loaded.model.readout
    if not (isinstance(readout, FieldReadout) and readout.tips is None):  # a field alone has its own calibration
        source_readout(loaded)
    if loaded.card.get('data', {}).get('origin') == CALIBRATION and gel and gel == loaded.gel:
        source = loaded.card['source']
        raise ModelError(
            f'model {loaded.model_id} is already calibrated for gel {gel}; to calibrate again start from its source '
            f'model, {source.get("model", source["model_id"])}'
        )


def write(
    source: Source,
    recordings: RecordedPresses,
    calibration: AnyCalibration,
    output: Path,
    *,
    seconds: float = 0.0,
    command: str = '',
    replaces: Mapping[str, str] | None = None,
) -> str:
    """The calibration as a model file; its id. `replaces` names the model that was in use, if it was not the source."""
    card = card_of(source, recordings, calibration, seconds, command, output)
    if replaces and replaces['model_id'] != source.loaded.model_id:
        card['replaces'] = dict(replaces)
    model = replace(source.loaded.model, readout=calibration.readout, model_id='unsaved')
    return save_model(output, model, card, recordings.rest_image)


def card_of(
    source: Source, recordings: RecordedPresses, calibration: AnyCalibration, seconds: float, command: str, output: Path
) -> dict[str, Any]:
    """The model's card: the entries of its source, and of the presses, with those that the source was made from."""
    known = source.loaded.card.get('data', {})
    return {
        **kept(source.loaded.card, calibration.readout),
        'command': command,
        'made_with': f'tactile_nodes {__version__}',
        'licence': 'the same as tactile_nodes',
        'gel': dict(recordings.card['gel']),
        'data': {
            'origin': CALIBRATION,
            'bags': [*(bag['id'] for bag in recordings.card['bags']), *known.get('bags', ())],
            'samples': len(recordings),
            'fingerprint': recordings.fingerprint,
            'pictures': [*recordings.pictures, *known.get('pictures', ())],
        },
        'source': source.card_entry(output),
        'training': {'seconds': seconds, 'device': 'cpu', 'calibration': calibration.as_dict()},
    }
