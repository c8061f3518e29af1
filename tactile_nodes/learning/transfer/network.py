"""Calibrate a network for another gel as the paper does: a layer before it, fitted to a few hundred presses.

A fifth of the places is held out. Of the remaining presses a tenth stops the training, and the others train the layer.
Stated uncertainty and the limit of the novelty check are measured again on the held-out presses.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.datasets.split import by_position
from tactile_nodes.learning.network.calibration import fit_limit, fit_spread
from tactile_nodes.learning.network.novelty_check_fit import with_novelty_check
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import LEAST_SPREAD
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.judgement import objection, of_the_mean, require_worth
from tactile_nodes.learning.transfer.layer import FittedLayer, LayerConfig, fit_layer
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.shapes import Int

LEAST_PRESSES = 40
"""Fewer presses do not determine ten million weights; of 40, four stop the training, and eight judge."""
ENCODING = 'polar_mean'


@dataclass(frozen=True)
class NetworkTransfer:
    """A calibrated readout, and how it was found; errors are of presses at held-out places.

    `before_paper` and `after_paper` hold the paper's three metrics on the same presses.
    """

    readout: NetworkReadout
    fitted: FittedLayer
    before: Errors
    after: Errors
    before_paper: Validation
    after_paper: Validation
    presses: int
    judged: int
    settings: LayerConfig
    objection: str = ''

    @property
    def form(self) -> str:
        return 'layer'

    @property
    def reason(self) -> str:
        """How the layer was found, in a sentence."""
        fitted = self.fitted
        return (
            f'{self.form}: rectified units before the network, best after epoch {fitted.best_epoch} of '
            f'{fitted.epochs_run} ({fitted.ended})'
        )

    def as_dict(self) -> dict[str, Any]:
        """The entry in the model card."""
        scores = {name: asdict(getattr(self, name)) for name in ('before', 'after', 'before_paper', 'after_paper')}
        counts = {'presses': self.presses, 'judged': self.judged, 'objection': self.objection}
        settings = {'settings': asdict(self.settings), 'fit': self.fitted.as_dict()}
        return {'form': self.form, 'reason': self.reason, **counts, **scores, **settings}


def transfer_network(
    loaded: LoadedModel,
    dataset: Dataset,
    config: LayerConfig | None = None,
    progress: Progress | None = None,
    *,
    forced: bool = False,
) -> NetworkTransfer:
    """The network of a model with a layer for the gel of a data set, and a novelty check of that gel.

    `forced` also accepts one that is no better on held-out presses than without the layer, or than their mean.

    Raises:
        ModelError: the layer cannot be put before this model; says which can be used.
        DatasetError: too few presses, or the calibration would not help.
        ConfigurationError: torch is not installed.
    """
    config, source = config or LayerConfig(), network_readout(loaded)
    touched = np.flatnonzero(dataset.presses[:, 3] > 0)
    presses = dataset.take(touched)
    require_presses(presses, source)
    split = by_position(presses.presses[:, :2], seed=config.seed, test=config.judged, validation=config.validation)
    learned, stops = shuffled_parts(np.sort(np.concatenate([split.train, split.validation])), config)
    fitted = fit_layer(source, presses, learned, stops, config, progress)
    judges = presses.take(split.test)
    calibrated = stated_anew(replace(source, layer=fitted.layer), judges)
    before, after = (_read(readout, judges) for readout in (source, calibrated))
    fault = _objection(before, after, of_the_mean(judges.presses[:, [0, 1, 3]]))
    advice = 'keep the model, press at more places, or take a smaller learning rate'
    require_worth(fault, advice, forced=forced)
    held_out = np.isin(np.arange(len(dataset.presses)), touched[split.test])
    calibrated = with_novelty_check(calibrated, dataset, held_out, ENCODING, progress or Progress())
    return NetworkTransfer(
        calibrated,
        fitted,
        before.errors,
        after.errors,
        before.paper,
        after.paper,
        len(touched),
        len(split.test),
        config,
        fault,
    )


def network_readout(loaded: LoadedModel) -> NetworkReadout:
    """The network of a model, if the paper's layer can be put before it.

    Raises:
        ModelError: it is no network, its features may be negative, or it has a layer already.
    """
    readout, layout = loaded.model.readout, loaded.model.layout
    if not isinstance(readout, NetworkReadout):
        raise ModelError(
            f"model {loaded.model_id} is not a network, but the paper's layer needs one; calibrate it "
            'without settings of a layer, or choose a network, such as paper'
        )
    if layout.encoding != ENCODING:
        raise ModelError(
            f'model {loaded.model_id} reads {layout.encoding}, but the rectified units of the layer would cut off '
            f'negative values, half of all motion; choose a network with encoding: {ENCODING}, such as paper, or '
            'start from portable'
        )
    if readout.layer is not None:
        raise ModelError(
            f'model {loaded.model_id} already has a calibration layer; calibrate the model that it was made from, '
            f'{loaded.card.get("source", {}).get("model_id", "named in its card")}'
        )
    return readout


def require_presses(presses: Dataset, source: NetworkReadout) -> None:
    """Refuse presses that are too few or too close together.

    Raises:
        DatasetError: says what to do.
    """
    if len(presses.presses) < LEAST_PRESSES:
        raise DatasetError(
            f"the paper's layer needs at least {LEAST_PRESSES} presses (the paper used 800), but there are "
            f'{len(presses.presses)}; record more, or calibrate a response model, such as fast, which needs ten'
        )
    bins = source.bins
    for name, width_mm, along in zip('xy', (bins.width_mm, bins.height_mm), presses.presses.T[:2], strict=True):
        if np.ptp(along) < LEAST_SPREAD * width_mm:
            raise DatasetError(
                f'the presses span {np.ptp(along):.1f} mm along {name} of the {width_mm:.1f} mm of the surface, too '
                'little to know how the gels differ elsewhere; press all over the surface'
            )


def shuffled_parts(
    rows: Int[np.ndarray, ' rows'], config: LayerConfig
) -> tuple[Int[np.ndarray, ' learned'], Int[np.ndarray, ' stops']]:
    """Training samples, and those that stop the training (at least one), drawn at random as in the paper."""
    drawn = np.random.default_rng(config.seed).permutation(rows)
    stops = max(1, round(config.validation * len(rows)))
    return np.sort(drawn[stops:]), np.sort(drawn[:stops])


def stated_anew(readout: NetworkReadout, judges: Dataset) -> NetworkReadout:
    """The readout with its uncertainty and its novelty limit measured on held-out presses.

    The novelty check of the other gel does not apply to this one.
    """
    inputs = np.stack([readout.inputs(*frame) for frame in _frames(judges)])
    total_n = np.array([readout.network(each).sum() for each in inputs]) * readout.output_scale_n
    spread = fit_spread(total_n, total_n - judges.presses[:, 3])
    likeness = None if readout.likeness is None else fit_limit(readout.likeness, inputs)
    return replace(readout, spread=spread, likeness=likeness, novelty_check=None)


def _frames(dataset: Dataset) -> list[tuple[np.ndarray, np.ndarray]]:
    """Features and confidence of each sample, as in the live node."""
    pairs = zip(dataset.features, dataset.rest, strict=True)
    return [(values.astype(np.float32), dataset.confidence[rest]) for values, rest in pairs]


@dataclass(frozen=True)
class _Scores:
    errors: Errors
    paper: Validation


def _read(readout: NetworkReadout, judges: Dataset) -> _Scores:
    read = [readout.read(*frame) for frame in _frames(judges)]
    found_n = np.stack([each.normal_force_n.reshape(-1) for each in read])
    contacts = np.array([(each.contacts[0].x_mm, each.contacts[0].y_mm, each.contacts[0].force_n) for each in read])
    errors = Errors.of(contacts - judges.presses[:, [0, 1, 3]])
    return _Scores(errors, Validation.of(judges.labels(readout.bins), found_n, readout.bins))


def _objection(before: _Scores, after: _Scores, mean: Errors) -> str:
    """Compare with the network without a layer by the paper's metric, which the layer was fitted to."""
    if after.paper.armse_n >= before.paper.armse_n:
        return (
            f'the calibration would not help: at held-out places the aRMSE is {after.paper.armse_n:.4f} N with it, '
            f'{before.paper.armse_n:.4f} N without'
        )
    return objection('calibration', after.errors, None, mean)
