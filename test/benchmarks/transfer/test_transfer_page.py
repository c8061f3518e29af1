"""The benchmark of transfer: its gels stay within what it says, and its table sums them up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.harness.command import parser_of
from benchmarks.harness.report import surroundings
from benchmarks.harness.running import run
from benchmarks.transfer import BENCHMARK
from benchmarks.transfer.page import Measured, draw, page
from benchmarks.transfer.scores import AS_IT_IS, CALIBRATED, OWN_GEL, TRAINED, Score
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.other_gels import LEARNED_SEED, other_gel

OWN = Score(-1, 0, AS_IT_IS, 0.001, 0.2, 0.002, 0.01, 0.02, 0.003, 0.9)


def result(own: Score, scores: list[Score], gels: Sequence[Gel] = (), pictures: int = 8) -> dict[str, Any]:
    return {**surroundings('tactile bench transfer'), '_page': Measured(own, scores, gels, pictures=pictures)}


@pytest.mark.parametrize('number', range(10))
def test_gels_differ_as_much_as_the_page_says(number: int) -> None:
    gel, own = other_gel(Gel(), number), Gel()
    assert gel.seed != own.seed
    assert abs(gel.shear_modulus_mpa / own.shear_modulus_mpa - 1) <= 0.3
    assert round(gel.soft_mm - own.soft_mm, 6) in (-0.3, 0.0, 0.3)
    assert max(map(abs, gel.camera_shift_mm)) <= 1.0
    assert max(map(abs, gel.camera_tilt_deg)) <= 2.0
    assert abs(gel.focal_px_per_rad / own.focal_px_per_rad - 1) <= 0.03
    assert abs(gel.camera_roll_deg) <= 3.0


def test_the_same_number_is_the_same_gel() -> None:
    assert other_gel(Gel(), 3).gel_id == other_gel(Gel(), 3).gel_id
    assert other_gel(Gel(), 3).gel_id != other_gel(Gel(), 4).gel_id


def test_the_table_has_median_and_worst_over_the_gels() -> None:
    scores = [
        Score(gel, 10, CALIBRATED, force_n, 0.2, 0.05, 0.01, 0.3, 0.02, 0.88, form, 3.0)
        for gel, force_n, form in ((0, 0.02, 'whole'), (1, 0.03, 'whole'), (2, 0.07, 'hardness'))
    ]
    text = page(result(replace(OWN, placed_armse_n=0.001), scores, [other_gel(Gel(), 0)]))
    assert '3 simulated gels' in text
    row = next(line for line in text.splitlines() if line.startswith(f'| {CALIBRATED}'))
    assert '0.0300 (0.0700)' in row
    assert '2 whole, 1 hardness' in row
    # The median and the largest of 0.02, 0.03 and 0.07 N over 0.001 N; the aRMSE is ten times the source's for all.
    assert ' 30.00x ±0.00 (70.00x ±0.00) |' in text
    assert ' 10.00x ±0.00 (10.00x ±0.00) |' in text


def scored(gel: int, presses: int, way: str, force_n: float) -> Score:
    return Score(gel, presses, way, force_n, 0.2, 0.05, 0.01, 0.3, 0.02, 0.88)


def test_calibrations_are_reported_in_times_what_each_gel_allows() -> None:
    scores = [
        scored(OWN_GEL, 3000, TRAINED, 0.0011),
        scored(0, 25, CALIBRATED, 0.006), scored(0, 3000, TRAINED, 0.002),
        scored(1, 25, CALIBRATED, 0.004), scored(1, 3000, TRAINED, 0.004),
        scored(2, 25, CALIBRATED, 0.006), scored(2, 3000, TRAINED, 0.003),
    ]  # fmt: skip
    text = page(result(OWN, scores))
    assert '3 simulated gels' in text
    rows = text.split('Compared with a model trained on each gel')[1].splitlines()
    # 3, 1 and 2 times what the same gels allow, which is 2, 4 and 3 times the source's own.
    assert any('25' in row and ' 2.00x ±0.00 (3.00x ±0.00) |' in row for row in rows)
    assert any(' 3.00x ±0.00 (4.00x ±0.00) |' in row for row in rows)
    assert any('own gel' in row and ' 1.10x ±0.00 (1.10x ±0.00) |' in row for row in rows)


def test_a_gel_that_bears_more_force_is_reported_as_a_share_of_it_too() -> None:
    own = replace(OWN, force_rmse_n=0.002, pressed_n=0.5)
    scores = [
        replace(scored(0, 25, CALIBRATED, 0.003), pressed_n=0.625),
        replace(scored(0, 100, CALIBRATED, 0.0025), pressed_n=0.625),
    ]
    row = page(result(own, scores)).split('Gel by gel')[1].splitlines()[8]
    # 3 and 2.5 mN over 2 mN, on a gel that bears a quarter more; the aRMSE is the source's own.
    cells = [each.strip() for each in row.split('|')[1:-1]]
    assert cells == ['0', '1.25x', '1.50x (1.20x)', '1.25x (1.00x)', '1.00x (0.80x)', '1.00x (0.80x)']


def test_without_models_of_their_own_gels_have_no_level_on_the_page() -> None:
    text = page(result(OWN, [scored(0, 25, CALIBRATED, 0.006)]))
    assert TRAINED not in text
    assert 'Compared with a model trained on each gel' not in text


@pytest.mark.parametrize('seed', [4077, LEARNED_SEED], ids=['to develop on', 'to learn from'])
def test_other_gels_are_none_of_those_tested(seed: int) -> None:
    tested = {other_gel(Gel(), number).gel_id for number in range(10)}
    assert not tested & {other_gel(Gel(), number, seed).gel_id for number in range(10)}


def test_the_figure_is_written(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    scores = [scored(0, 10, CALIBRATED, 0.02), scored(0, 3000, TRAINED, 0.01), scored(OWN_GEL, 3000, TRAINED, 0.002)]
    draw(result(replace(OWN, placed_armse_n=0.001), scores), tmp_path, 'transfer')
    assert (tmp_path / 'transfer.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(('pictures', 'sentence'), [(1, 'one picture each'), (8, 'held for 8 pictures each')])
def test_the_page_says_how_many_pictures_of_a_press_calibrations_get(pictures: int, sentence: str) -> None:
    own = scored(OWN_GEL, 0, AS_IT_IS, 0.001)
    assert sentence in page(result(own, [scored(0, 10, CALIBRATED, 0.006)], pictures=pictures))


@pytest.mark.parametrize('words', [['--pictures', '0'], ['--gels', '0'], ['--own', '10']])
def test_numbers_that_nothing_can_be_measured_with_are_refused(words: list[str]) -> None:
    with pytest.raises(ConfigurationError, match=words[0]):
        run(BENCHMARK, parser_of(BENCHMARK).parse_args(words))
