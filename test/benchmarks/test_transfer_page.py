"""The benchmark of transfer: its gels stay within what it says, and its table sums them up."""

from __future__ import annotations

import pytest

from tactile_nodes.benchmarks.transfer import AS_IT_IS, CALIBRATED, Score, other_gel, page
from tactile_nodes.simulation.gel import Gel


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
    own = Score(-1, 0, AS_IT_IS, 0.001, 0.01, 0.001)
    scores = [
        Score(gel, 10, CALIBRATED, force_n, 0.2, 0.01, form, 3.0)
        for gel, force_n, form in ((0, 0.02, 'affine'), (1, 0.03, 'affine'), (2, 0.07, 'gain'))
    ]
    text = page('tactile bench transfer', own, scores)
    assert '3 simulated gels' in text
    row = next(line for line in text.splitlines() if line.startswith(f'| {CALIBRATED}'))
    assert '0.0300 (0.0700)' in row
    assert '2 affine, 1 gain' in row
