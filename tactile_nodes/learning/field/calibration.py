"""Readouts `field` from training runs, from calibrations, and from a description alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import __version__
from tactile_nodes.errors import ConfigurationError, DatasetError, ModelError
from tactile_nodes.learning.config import FieldConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import BALL_MM, BODY, Bodies, KnownBody, body_of_card
from tactile_nodes.learning.field.fit import (
    DOTS_NOISE_PX,
    FieldFit,
    described,
    fit_field,
    regions_of,
    scaling_of,
    uncovered,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import source_readout
from tactile_nodes.learning.transfer.fit import OtherGel, Transfer, folds_of, transfer
from tactile_nodes.learning.transfer.judgement import ADVICE, describe_errors, require_worth
from tactile_nodes.model_file import (
    DESCRIPTION,
    SENSOR,
    LoadedModel,
    crop_of_size,
    find_model,
    load_model,
    save_model,
    shipped_model,
)
from tactile_nodes.params import from_mapping
from tactile_nodes.sensing.explain.arrays import AnyReadout
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.refinement import Refinement
from tactile_nodes.sensing.flow.dots import NO_TEXTURE, DotsFlow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.sensors.writing import values_of

KEPT = 'flow', 'encoding', 'crop_px'
"""Keys that a calibrated model's card copies from its source."""


def train_field(
    dataset: Dataset, config: FieldConfig, bins: BinGrid, progress: Progress
) -> tuple[FieldReadout, dict[str, Any]]:
    """The readout of a training run: tips by the model that it names, and the field from its presses.

    Raises:
        ModelError: there is no such model of tips, or it reads other features or bins.
        ConfigurationError: there is no such sensor, or its bins differ.
    """
    sensor, tips = load_sensor(config.sensor), load_model(find_model(config.tips)).model.readout
    if not isinstance(tips, AxisymmetricReadout):
        raise ModelError(
            f'field.tips names {config.tips}, which is a {tips.kind}; name an axisymmetric model: portable'
        )
    require_bins(sensor, bins)
    tips.require_fit(dataset.features[0].size, bins)
    bodies = Bodies.one(KnownBody.named(config.body), len(dataset.presses))
    fit = fitted_field(sensor, replace(tips, prior=None), dataset, bodies, progress)
    report = {'form': fit.form, 'gain': fit.gain, 'presses': fit.presses, 'misfits': dict(fit.misfits)}
    return replace(fit.readout, tips=tips), report


@dataclass(frozen=True)
class Pressed:
    """The sensor and the pressing body as given by a person; if None, those of the presses or of the source."""

    sensor: Sensor | None = None
    body: KnownBody | None = None

    def to_card(self, card: Mapping[str, Any], bodies: Bodies | None = None) -> dict[str, Any]:
        """A source's card with these entries, or with the bodies."""
        entries = {**card, **({SENSOR: values_of(self.sensor)} if self.sensor else {})}
        if body := bodies or self.body:
            entries.pop(BALL_MM, None)
            entries[BODY] = body.card_name
        return entries

    def bodies(self, loaded: LoadedModel, dataset: Dataset) -> Bodies:
        """The body of each sample, as in `named`.

        Raises:
            DatasetError: an indenter is no body.
            ModelError: the body is unknown.
        """
        touched = dataset.presses[:, 2] > 0
        if dataset.indenter is None or not touched.any():
            return Bodies.one(self.known_body(loaded), len(touched))
        names, of = np.unique(dataset.indenter[touched], return_inverse=True)
        each = [self.named(loaded, name, alone=len(names) == 1) for name in names.tolist()]
        by_name = {body.name: body for body in each}
        which = np.zeros(len(touched), int)
        which[touched] = np.array([list(by_name).index(body.name) for body in each])[of.reshape(-1)]
        return Bodies(tuple(by_name.values()), which)

    def named(self, loaded: LoadedModel, indenter: str, *, alone: bool) -> KnownBody:
        """The body of this name; the person's if the name is empty, or if one is given and the indenter is `alone`.

        Raises:
            DatasetError: it is no body.
            ModelError: the body is unknown.
        """
        if not indenter or (self.body and alone):
            return self.known_body(loaded)
        try:
            return KnownBody.named(indenter)
        except ConfigurationError as error:
            hint = '; or name it with --body' if alone else ''
            raise DatasetError(f'the indenter {indenter!r} is not a known body: {error}{hint}') from error

    def known_body(self, loaded: LoadedModel) -> KnownBody:
        """The pressing body.

        Raises:
            ModelError: neither the person nor the source names it.
        """
        return self.body or body_of_card(loaded.card, loaded.model_id)

    def known_sensor(self, loaded: LoadedModel) -> Sensor:
        """The pressed sensor.

        Raises:
            ModelError: neither the person nor the source describes it.
            ConfigurationError: its bins differ from those of the source.
        """
        sensor = self.sensor or sensor_of(loaded.card, loaded.model_id)
        require_bins(sensor, loaded.model.bins)
        return sensor


def pressed_by(loaded: LoadedModel, sensor: str = '', body: str = '') -> Pressed:
    """Sensor and body by the names that a person gives; if empty, those of the model.

    Raises:
        ConfigurationError: there is none of that name, the body is wider than the gel, or the model has no force field.
        ModelError: the person leaves out a name that the model does not have either.
    """
    if not (sensor or body):
        return Pressed()
    if not isinstance(loaded.model.readout, FieldReadout):
        raise ConfigurationError(
            f'a sensor and a body need a model of any contact, such as field, but {loaded.model_id} is '
            f'{loaded.model.readout.kind}'
        )
    pressed = Pressed(load_sensor(sensor) if sensor else None, KnownBody.named(body) if body else None)
    if pressed.body:
        pressed.body.require_within(pressed.known_sensor(loaded))
    return pressed


def kept(card: Mapping[str, Any], readout: AnyReadout) -> dict[str, Any]:
    """The entries that a calibrated model's card copies from its source; of a field also its body."""
    names = (*KEPT, SENSOR, BODY, BALL_MM) if isinstance(readout, FieldReadout) else KEPT
    return {name: card[name] for name in names if name in card}


def with_field(
    loaded: LoadedModel,
    calibration: Transfer,
    dataset: Dataset,
    progress: Progress | None = None,
    pressed: Pressed | None = None,
    *,
    forced: bool = False,
    curve: bool = False,
) -> Transfer:
    """A calibration of a model `field`: tips are calibrated already, the field is fitted to the same presses.

    If the gel has sides, tips are calibrated again, with what these add to their motion.

    `forced` also accepts presses by which the camera differs from its description. `curve` adds the errors with fewer
    presses.

    Raises:
        ModelError: neither the person nor the source gives the body, or the sensor.
        DatasetError: an indenter is no body, or by the presses the camera differs from its description and it was not
            forced.
        ConfigurationError: a body is wider than the gel.
    """
    if not isinstance(loaded.model.readout, FieldReadout) or not isinstance(calibration.readout, AxisymmetricReadout):
        return calibration
    pressed = pressed or Pressed()
    sensor, bodies = pressed.known_sensor(loaded), pressed.bodies(loaded, dataset)
    refinement = refinement_of(loaded, sensor)
    fit = fitted_field(
        sensor, calibration.readout, dataset, bodies, progress or Progress(), curve=curve, refinement=refinement
    )
    require_worth(fit.objection, ADVICE, forced=forced)
    if fit.sides is not None:
        calibration = transfer(source_readout(loaded), dataset, progress, forced=forced, sides=fit.sides)
    assert isinstance(calibration.readout, AxisymmetricReadout)
    text = f'{fit.reason}; alone it reads held-out presses {describe_errors(fit.errors)} off (medians)'
    readout = replace(fit.readout, tips=calibration.readout)
    return replace(
        calibration, readout=readout, field=text, curve=fit.curve, objection=calibration.objection or fit.objection,
        gives_px=calibration.gives_px or fit.gives_px,
    )  # fmt: skip


def fitted_field(
    sensor: Sensor,
    tips: AxisymmetricReadout,
    dataset: Dataset,
    bodies: Bodies,
    progress: Progress,
    *,
    curve: bool = False,
    refinement: Refinement | None = None,
) -> FieldFit:
    """The fit to one image of each press; `refinement` is as in `fit_field`."""
    other = OtherGel.of(tips, dataset)
    scaling, fold = uncovered(sensor, other.live_scaling), folds_of(other.presses.contacts)
    return fit_field(sensor, scaling, dataset, other.rows, fold, bodies, progress, curve=curve, refinement=refinement)


def described_model(loaded: LoadedModel, sensor: Sensor, gel: str, output: Path, progress: Progress) -> str:
    """Write the model of a sensor without any presses, from its description alone; its id.

    Raises:
        ModelError: the source has no force field.
        ConfigurationError: the image shows too little of the gel.
    """
    readout, model = loaded.model.readout, loaded.model
    if not isinstance(readout, FieldReadout):
        raise ModelError(f'model {loaded.model_id} is a {readout.kind}, but a description gives a field: --model field')
    source = loaded.card
    dots = sensor.pattern.kind == 'dots'
    if model.bins == BinGrid.of_sensor(sensor) and not dots and _sees_alike(sensor, sensor_of(source, loaded.model_id)):
        scaling = uncovered(sensor, replace(readout.scaling, mean=np.zeros_like(readout.scaling.mean)))
        layout = model.layout
    else:
        usual = float(np.median(readout.scaling.gain[readout.scaling.trusted > 0]))
        scaling = scaling_of(sensor, 1 / DOTS_NOISE_PX if dots else usual)
        layout = replace(model.layout, rows=scaling.trusted.shape[0], cols=scaling.trusted.shape[1])
    field_readout = described(sensor, scaling, progress, refinement_of(loaded, sensor)).readout
    covered = np.flatnonzero(regions_of(sensor, scaling).covered).tolist()
    card = {
        **measured_by(sensor, source, {'rows': layout.rows, 'cols': layout.cols}, covered),
        'crop_px': crop_of_size(sensor.image.crop_px),
        **Pressed(sensor).to_card({}),
        'gel': {'id': gel or sensor.name},
        'data': {'origin': DESCRIPTION},
        'made_with': f'tactile_nodes {__version__}',
    }
    new_model = replace(model, layout=layout, bins=field_readout.bins, readout=field_readout, model_id='unsaved')
    return save_model(output, new_model, card)


def refinement_of(loaded: LoadedModel, sensor: Sensor) -> Refinement | None:
    """The refinement of a model `field`, or else of the shipped model of that name, if it was learnt for this sensor.

    The gel, camera, pattern and bins must be the same by the description.
    """
    shipped = shipped_model(sensor.name)
    for model in (loaded, *((load_model(shipped),) if shipped else ())):
        readout = model.model.readout
        if isinstance(readout, FieldReadout) and readout.refinement is not None and _is_of(model, sensor):
            return readout.refinement
    return None


def _is_of(model: LoadedModel, sensor: Sensor) -> bool:
    """Whether a model is of a sensor, except for its modulus."""
    source = sensor_of(model.card, model.model_id)
    patterns = {(each.pattern.kind, each.pattern.pitch_mm) for each in (sensor, source)}
    alike = _sees_alike(sensor, source) and sensor.gel.layers_mm == source.gel.layers_mm
    return alike and model.model.bins == BinGrid.of_sensor(sensor) and len(patterns) == 1


def _sees_alike(one: Sensor, other: Sensor) -> bool:
    """Whether images of both sensors show the same part of the gel, so that the same regions are known."""
    (images, known) = ((each.image.crop_px, each.camera, each.gel.outline) for each in (one, other))
    return images == known


def measured_by(
    sensor: Sensor, source: Mapping[str, Any], regions: dict[str, int], covered: list[int]
) -> dict[str, Any]:
    """Flow and encoding: those of the source, or the flow by dots for printed ones, without texture weights."""
    dots = sensor.pattern.kind == 'dots'
    flow: Mapping[str, Any] = {'name': DotsFlow.name, 'options': {}} if dots else source['flow']
    encoding, unseen = source['encoding'], {'covered': covered} if covered else {}
    weighed = {'texture_grey': NO_TEXTURE} if dots else {}
    return {
        'flow': {**flow, 'options': {**flow['options'], **regions, **unseen}},
        'encoding': {**encoding, 'options': {**encoding['options'], **regions, **weighed}},
    }


def require_bins(sensor: Sensor, bins: BinGrid) -> None:
    """Refuse a description whose force bins differ.

    Raises:
        ConfigurationError: names both.
    """
    if (own := BinGrid.of_sensor(sensor)) != bins:
        raise ConfigurationError(
            f'the sensor {sensor.name} has {_bins(own)}, but the model reports forces on {_bins(bins)}; change one of '
            'them, or start from a model of its description: tactile calibrate --sensor YAML --model field '
            '-o described.safetensors'
        )


def _bins(bins: BinGrid) -> str:
    return f'{bins.rows}x{bins.cols} bins over {bins.width_mm:g}x{bins.height_mm:g} mm'


def card_of_sensor(config: FieldConfig) -> dict[str, Any]:
    """The entries for the sensor and the pressing body on the card of a training run."""
    return Pressed(load_sensor(config.sensor), KnownBody.named(config.body)).to_card({})


def sensor_of(card: Mapping[str, Any], model_id: str) -> Sensor:
    """The sensor that a card describes.

    Raises:
        ModelError: it describes none.
    """
    if SENSOR not in card:
        raise ModelError(f'model {model_id} does not name its sensor; download it again or train it again')
    return from_mapping(Sensor, card[SENSOR], source=f'the card of model {model_id}', exact=False)
