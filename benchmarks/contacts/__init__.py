"""Accuracy for any contact: rigid bodies of ten families are pressed and dragged on the simulated gel.

Contacts are solved at finite strain (some ten seconds each; solutions stay in the cache). The whole chain of a live
launch estimates the forces. Models `field` are calibrated with 100, 10 and no presses on the gel that is touched.
`paper`, `fast` and `portable` are tested as they ship, on the gel that they were trained on. The best model is run
once more with its inner loops compiled, for its CPU time.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.contacts.page import BEST, PRESSES, page
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Result, argument
from benchmarks.harness.running import Run
from benchmarks.speed_accuracy import draw_contacts as draw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.contacts.cases import Case
    from benchmarks.contacts.frames import Condition
    from benchmarks.contacts.scores import Score
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.simulation.gel import Gel

SEED, PER_FAMILY = 303, 8
PROFILES = 'paper', 'fast', 'portable'


def measure(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure all models on the same pictures, then the field on disturbed ones."""
    from benchmarks.contacts.cases import broad_cases, solved, wanted
    from benchmarks.contacts.frames import CONDITIONS
    from benchmarks.contacts.scores import by_family, summed
    from tactile_nodes.simulation.gel import Gel

    gel, progress = Gel(seed=arguments.gel_seed), run.progress
    chosen = run.made(solved, wanted(gel, arguments.seed, arguments.each), 'solving contacts')
    with tempfile.TemporaryDirectory() as folder:
        models = _models(arguments, gel, Path(folder), progress)

        def undisturbed() -> Result:
            scores, dis_ms = read(models, gel, chosen, CONDITIONS[0], progress)
            scores |= _read_compiled(models[BEST], gel, chosen, progress)
            summaries = {name: {**summed(each), 'families': by_family(each)} for name, each in scores.items()}
            return {'dis_ms': dis_ms, 'models': summaries}

        def broad() -> Result:
            found, _ = read(models, gel, broad_cases(gel, progress), CONDITIONS[0], progress)
            return {name: [_broad_entry(each) for each in judged] for name, judged in found.items()}

        def disturbed(condition: Condition) -> dict[str, float]:
            scores, _ = read({BEST: models[BEST]}, gel, chosen, condition, progress)
            return summed(*scores.values())

        return {
            'seed': arguments.seed,
            'each': arguments.each,
            **run.part('undisturbed', undisturbed),
            'broad': run.part('broad', broad),
            'disturbed': {
                each.name: run.part(f'disturbed, {each.name}', partial(disturbed, each))
                for each in (() if arguments.no_disturbances else CONDITIONS)
            },
        }


def _broad_entry(score: Score) -> dict[str, Any]:
    """Entries of a broad contact: true and estimated force, and whether the interval contains the true one."""
    return {
        'contact': score.family, 'true_n': score.true_n, 'told_n': score.true_n + score.total_n,
        'misplaced': score.misplaced, 'held': score.total_held, 'ok': score.ok,
    }  # fmt: skip


def _models(arguments: argparse.Namespace, gel: Gel, folder: Path, progress: Progress) -> dict[str, str]:
    """The models by their names on the page."""
    from benchmarks.contacts.models import calibrated
    from tactile_nodes.model_file import find_model, load_model

    source = load_model(find_model(arguments.source))
    own = {
        f'field, {presses or "no"} presses': str(calibrated(source, gel, presses, folder, progress))
        for presses in PRESSES
    }
    return {**(dict(zip(PROFILES, PROFILES, strict=True)) if arguments.gel_seed == 1 else {}), **own}


def _read_compiled(model: str, gel: Gel, chosen: Sequence[Case], progress: Progress) -> dict[str, list[Score]]:
    """Scores of the best model with compiled inner loops, if numba is installed."""
    from benchmarks.contacts.frames import CONDITIONS
    from tactile_nodes.sensing.compiling import can_compile

    if not can_compile():
        return {}
    return read({f'{BEST}, compiled': model}, gel, chosen, CONDITIONS[0], progress, compiled=True)[0]


def read(
    models: dict[str, str],
    gel: Gel,
    chosen: Sequence[Case],
    condition: Condition,
    progress: Progress,
    *,
    compiled: bool = False,
) -> tuple[dict[str, list[Score]], float]:
    """Scores of each chain for each contact, and the CPU time of OpenCV's DIS in the same run (ms, median)."""
    import numpy as np

    from benchmarks.contacts.frames import frames
    from benchmarks.contacts.scores import score
    from benchmarks.front.profiles import Profile
    from benchmarks.stability.chain import Chain
    from tactile_nodes.model_file import find_model, load_model
    from tactile_nodes.sensing.flow.choice import make_flow

    loaded = {name: load_model(find_model(model)) for name, model in models.items()}
    size_px = next(iter(loaded.values())).image_size
    alone = {
        name: Profile(name, each, make_flow(*each.flow, compiled=compiled and each.flow[0] != 'dis'), compiled)
        for name, each in loaded.items()
    }
    chains = {name: Chain(model, compiled=compiled) for name, model in models.items()}
    found: dict[str, list[Score]] = {name: [] for name in models}
    dis, dis_ms, first = make_flow('dis', {'preset': 'medium'}), [], True
    with progress.bar(f'reading contacts, {condition.name}', len(chosen)) as bar:
        for frame in frames(gel, chosen, condition, 1000, size_px):
            if first:
                dis.set_reference(frame.picture)
                for each in alone.values():
                    each.use_reference(frame.picture)
                first = False
            for name, chain in chains.items():
                begun = time.process_time()
                force = chain.read(frame.stamp_ns, frame.picture)
                spent_ms = 1e3 * (time.process_time() - begun)
                if frame.judged is not None:
                    alone[name].take(frame.picture)
                    times = spent_ms, sum(alone[name].times_ms[-1])
                    nominal = chain.nominal_n(float(force.total))
                    found[name].append(score(frame.judged, force, chain.field(force), gel, times, nominal))
            if frame.judged is not None:
                begun = time.process_time()
                dis.displacement(frame.picture)
                dis_ms.append(1e3 * (time.process_time() - begun))
                bar.advance()
    return found, float(np.median(dis_ms))


BENCHMARK = Benchmark(
    name='contacts',
    about=__doc__,
    sources=(
        'benchmarks/contacts/**',
        'benchmarks/disturbances.py',
        'benchmarks/stability/chain.py',
        'tactile_nodes/learning/**',
        *SENSING,
        *SIMULATED,
    ),
    page=page,
    measure=measure,
    draw=draw,
    tasks=True,
    seed=SEED,
    files=('contacts.json', 'contacts.md', 'speed_accuracy.png'),
    arguments=(
        argument(
            '--each', type=int, default=PER_FAMILY, metavar='N', help=f'contacts of each family (default: {PER_FAMILY})'
        ),
        argument('--source', default='field', metavar='MODEL', help='the model to calibrate from'),
        argument('--gel-seed', type=int, default=1, help="seed of the gel's markers (default: 1, as the profiles)"),
        argument('--no-disturbances', action='store_true', help='undisturbed pictures only'),
    ),
    example="""\
examples:
  tactile bench contacts -o docs/results
  tactile bench contacts --each 2 --no-disturbances    # a few contacts, to see that it runs""",
)
