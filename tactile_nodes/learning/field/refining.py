"""Learns the refinement of a field from simulated touches, as calibrations of other gels solve them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.pressed_gels import first_presses, planned
from tactile_nodes.learning.field.body import Bodies, KnownBody
from tactile_nodes.learning.field.calibration import fitted_field
from tactile_nodes.learning.field.random_touches import GELS, Touches, random_touches, touched_gel
from tactile_nodes.learning.field.refinement_fit import Samples, fit_refinement, misplaced, shares_of
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import done
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.refinement import FORCE_TIMES
from tactile_nodes.sensors import Sensor, load_sensor

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
    """The readout with a refinement, if that misplaces clearly less force of held-out bodies; and what was found."""
    assert readout.tips is not None
    touches = random_touches(config, config.field.touches, progress)
    solving = _calibrations(config, load_sensor(config.field.sensor), readout.tips, progress)
    samples = [Samples.joined([_solved(each, touched) for each in solving[touched.gel]]) for touched in touches]
    held_out = Samples.joined(samples[::HELD_OUT])
    learnt_from = Samples.joined([each for number, each in enumerate(samples) if number % HELD_OUT])
    refinement = fit_refinement(learnt_from, config.training.seed, progress)
    refined = np.stack([shares_of(refinement, each) for each in held_out.inputs])
    before, after = (misplaced(each, held_out.true) for each in (held_out.solved, refined))
    taken = after < WORTH * before
    progress.say(
        f'held-out bodies: {100 * before:.1f} % of the force is misplaced, {100 * after:.1f} % after refinement; '
        f'it is {"taken" if taken else "not taken"}'
    )
    report = {'bodies': len(touches), 'misplaced': before, 'misplaced_refined': after}
    return (replace(readout, refinement=refinement) if taken else readout), report


def _solved(readout: FieldReadout, touches: Touches) -> Samples:
    """The touches as a calibrated readout solves them."""
    found: list[tuple[np.ndarray, np.ndarray, float]] = []
    for values, confidence, forces_n in zip(touches.features, touches.confidence, touches.forces_n, strict=True):
        total_n = float(forces_n[0].sum())
        solved = readout.solved(values, confidence)
        if solved is None or total_n <= 0 or solved[0].total_n < LEAST_TOLD * total_n:
            continue
        found.append((solved[1], forces_n / total_n, total_n))
    shape = touches.forces_n.shape[2:]
    inputs = np.array([each for each, _, _ in found], np.float32).reshape(len(found), -1, *shape)
    true = np.array([each for _, each, _ in found], np.float32).reshape(-1, 3, *shape)
    return Samples(inputs, inputs[:, :3] / FORCE_TIMES, true, np.array([each for _, _, each in found], np.float32))


@dataclass(frozen=True)
class _Calibrated:
    """Task: the calibrations of one gel."""

    config: TrainConfig
    sensor: Sensor
    tips: AxisymmetricReadout


def _calibrations(
    config: TrainConfig, sensor: Sensor, tips: AxisymmetricReadout, progress: Progress
) -> Sequence[list[FieldReadout]]:
    """Readouts of each gel, from few and from many presses."""
    jobs = [_Calibrated(touched_gel(config, number), sensor, tips) for number in range(GELS)]
    found: dict[int, list[FieldReadout]] = {}
    with progress.bar('calibrating other gels', GELS) as bar:
        for number, readouts in done(_readouts_of, jobs, config.data.processes):
            found[number] = readouts
            bar.advance()
    return [found[number] for number in range(GELS)]


def _readouts_of(job: _Calibrated) -> list[FieldReadout]:
    presses, body = planned(job.config, Progress()), KnownBody.named(job.config.field.body)
    fitted = []
    for count in COUNTS:
        few = first_presses(presses, count)
        bodies = Bodies.one(body, len(few.presses))
        fitted.append(fitted_field(job.sensor, replace(job.tips, prior=None), few, bodies, Progress()).readout)
    return fitted
