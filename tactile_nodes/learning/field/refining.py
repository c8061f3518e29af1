"""Learns the refinement of a field from simulated touches, as calibrations of other gels solve them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import Choice, TrainConfig
from tactile_nodes.learning.datasets.pressed_gels import first_presses, planned
from tactile_nodes.learning.field.body import Bodies, KnownBody
from tactile_nodes.learning.field.calibration import fitted_field, sensor_of
from tactile_nodes.learning.field.fit import as_described, regions_of
from tactile_nodes.learning.field.random_touches import Scene, Touches, random_touches
from tactile_nodes.learning.field.refinement_fit import Samples, fit_refinement, misplaced, shares_of, totals_off
from tactile_nodes.learning.network.layers import import_torch
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import done
from tactile_nodes.model_file import load_model, save_model
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.refinement import FORCE_TIMES, INPUTS, Refinement
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.other_gels import LEARNED_SEED, other_gel

GELS = 6
"""Gels that a run touches in turn."""

SEED, LEAST_TOUCHES = 1, 24
"""Seed of the network of a described sensor, and least number of its touches."""

COUNTS = 10, 100
"""Numbers of presses in the calibrations that solve the touches."""

HELD_OUT = 8
"""One of so many bodies is held out, to judge the network."""

WORTH = 0.9
"""Share of the misplaced force that the network may leave to be taken."""

LEAST_TOLD = 0.3
"""Touches of which a smaller share of the force is told are not learnt from."""


def with_refinement(
    readout: FieldReadout, config: TrainConfig, progress: Progress
) -> tuple[FieldReadout, dict[str, Any]]:
    """The readout of a run with a refinement, learnt on other gels, if it is taken; and what was found."""
    assert readout.tips is not None
    gels = [replace(config, gel=other_gel(config.gel, number, LEARNED_SEED)) for number in range(GELS)]
    scenes = [
        Scene(each.gel, each.bins, (each.data.crop, each.data.crop), each.flow, each.encoding, each.data.seed)
        for each in gels
    ]
    touches = random_touches(scenes, config.field.touches, config.data.processes, progress)
    solving = _calibrations(gels, load_sensor(config.field.sensor), readout.tips, progress)
    refinement, report = _learnt(touches, solving, config.training.seed, progress, keeps_total=True)
    return replace(readout, refinement=refinement), report


def require_touches(touches: int, sensor: Sensor) -> None:
    """Refuse what a refinement cannot be learnt from.

    Raises:
        ConfigurationError: so few touches do not suffice, the sensor cannot be simulated, or torch is not installed.
    """
    if touches < LEAST_TOUCHES:
        raise ConfigurationError(f'{touches} touches are too few to learn from; give --touches {LEAST_TOUCHES} or more')
    gel_of(sensor)
    import_torch()


def refine_described(file: Path, touches: int, processes: int, progress: Progress) -> str:
    """Learn the refinement of a model of a described sensor from that many touches, and write it again; its id.

    Raises:
        ConfigurationError: too few bodies can be pressed into the gel.
    """
    loaded = load_model(file)
    readout, sensor = loaded.model.readout, sensor_of(loaded.card, loaded.model_id)
    assert isinstance(readout, FieldReadout)
    flow, encoding = Choice(*loaded.flow), Choice(*loaded.encoding)
    scene = Scene(gel_of(sensor), loaded.model.bins, loaded.image_size, flow, encoding, to_rim=True)
    made = random_touches([scene], touches, processes, progress)
    near = regions_of(sensor, readout.scaling).near
    learnt, report = _learnt(made, [[readout]], SEED, progress, keeps_total=not near)
    card = {**loaded.card, 'training': {'refinement': report}}
    model = replace(loaded.model, readout=as_described(readout, sensor, learnt), model_id='unsaved')
    return save_model(file, model, card)


def _learnt(
    touches: Sequence[Touches],
    solving: Sequence[Sequence[FieldReadout]],
    seed: int,
    progress: Progress,
    *,
    keeps_total: bool,
) -> tuple[Refinement | None, dict[str, Any]]:
    """The refinement, if it misplaces clearly less force of held-out bodies; and what was found.

    The touches of each scene are solved by readouts of their own. `keeps_total` is as in `Refinement`.

    Raises:
        ConfigurationError: too few bodies can be pressed into the gel.
    """
    samples = [Samples.joined([_solved(each, touched) for each in solving[touched.scene]]) for touched in touches]
    held_out, learnt_from = samples[::HELD_OUT], [each for k, each in enumerate(samples) if k % HELD_OUT]
    if not all(any(len(each.inputs) for each in part) for part in (held_out, learnt_from)):
        raise ConfigurationError('none of the bodies can be pressed into this gel, or read from it; take more touches')
    judged = Samples.joined(held_out)
    refinement = fit_refinement(Samples.joined(learnt_from), seed, progress, keeps_total=keeps_total)
    moved = np.stack([shares_of(refinement, each) for each in judged.inputs])
    before, after = (misplaced(each, judged.true) for each in (judged.solved, moved))
    off, off_after = (totals_off(each, judged) for each in (judged.solved, moved))
    taken = after < WORTH * before
    progress.say(
        f'held-out bodies: {100 * before:.1f} % of the force is misplaced, {100 * after:.1f} % after refinement; the '
        f'total is {100 * off:.1f} and {100 * off_after:.1f} % off (medians); it is {"taken" if taken else "not taken"}'
    )
    report = {
        'bodies': len(touches), 'misplaced': before, 'misplaced_refined': after, 'off': off, 'off_refined': off_after
    }  # fmt: skip
    return (refinement if taken else None), report


def _solved(readout: FieldReadout, touches: Touches) -> Samples:
    """The touches as a calibrated readout solves them."""
    found: list[tuple[np.ndarray, np.ndarray, tuple[float, float]]] = []
    for values, confidence, forces_n in zip(touches.features, touches.confidence, touches.forces_n, strict=True):
        total_n = float(forces_n[0].sum())
        solved = readout.solved(values, confidence)
        if solved is None or total_n <= 0 or solved[0].total_n < LEAST_TOLD * total_n:
            continue
        found.append((solved[1], forces_n / total_n, (total_n, solved[0].total_n)))
    shape = touches.forces_n.shape[2:]
    inputs = np.array([each for each, _, _ in found], np.float32).reshape(-1, INPUTS, *shape)
    true = np.array([each for _, each, _ in found], np.float32).reshape(-1, 3, *shape)
    totals = np.array([totals for *_, totals in found], np.float32).reshape(-1, 2)
    return Samples(inputs, inputs[:, :3] / FORCE_TIMES, true, totals[:, 0], totals[:, 1])


@dataclass(frozen=True)
class _Calibrated:
    """Task: the calibrations of one gel."""

    config: TrainConfig
    sensor: Sensor
    tips: AxisymmetricReadout


def _calibrations(
    gels: Sequence[TrainConfig], sensor: Sensor, tips: AxisymmetricReadout, progress: Progress
) -> list[list[FieldReadout]]:
    """Readouts of each gel, from few and from many presses."""
    jobs = [_Calibrated(config, sensor, tips) for config in gels]
    found: dict[int, list[FieldReadout]] = {}
    with progress.bar('calibrating other gels', len(jobs)) as bar:
        for number, readouts in done(_readouts_of, jobs, gels[0].data.processes):
            found[number] = readouts
            bar.advance()
    return [found[number] for number in range(len(jobs))]


def _readouts_of(job: _Calibrated) -> list[FieldReadout]:
    presses, body = planned(job.config, Progress()), KnownBody.named(job.config.field.body)
    fitted = []
    for count in COUNTS:
        few = first_presses(presses, count)
        bodies = Bodies.one(body, len(few.presses))
        fitted.append(fitted_field(job.sensor, replace(job.tips, prior=None), few, bodies, Progress()).readout)
    return fitted
