"""Snapshots as text."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from rich.console import Console
from seen import MS, diagnostics, force, received, ring

from tactile_nodes import conversions
from tactile_nodes.cli.view import map as view_map
from tactile_nodes.cli.view import render as view_render
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.viewing.state import ViewState


def pressed(bins: tuple[float, ...] = (0.0, 0.25, 0.0, 0.0)) -> ViewState:
    """One frame with its truth: 0.25 N against 0.5 N, 5 mm apart."""
    state = ViewState()
    state.estimators = ('/force_estimator',)
    provenance = types.Provenance(model='paper', model_id='abc', gel='soft', reference_id='def')
    stages = types.StageTimes(acquire=0.001, flow=0.002, features=0.003, predict=0.0005)
    state.add_truth(received(force(10, (0.0, 0.5, 0.0, 0.0), (3.0, 4.0)), 11))
    state.add_force(received(force(10, bins, (0.0, 0.0), provenance=provenance, stages=stages), 20))
    return state


def drawn(state: ViewState, now_ms: float = 30, **kw: float) -> list[str]:
    return view_render.picture(state.snapshot(round(now_ms * MS)), **kw).plain.splitlines()


def test_the_map_shows_newtons_and_marks_the_true_bin() -> None:
    assert any(line.startswith('  .  ›0.25') for line in drawn(pressed()))


def test_the_scale_is_stated_and_does_not_follow_the_force() -> None:
    assert any('1 N per bin (fixed)' in line for line in drawn(pressed((0.0, 30.0, 0.0, 0.0))))
    assert any('0.2 N per bin (fixed)' in line for line in drawn(pressed(), full_scale_n=0.2))


def test_a_bin_has_the_colour_of_its_force_on_the_fixed_scale() -> None:
    colours = [view_map._colour(force_n, 1.0).bgcolor for force_n in (0.3, 0.6, 1.0, 7.0)]
    assert colours[0] != colours[1] != colours[2]
    assert colours[2] == colours[3]
    assert view_map._colour(0.3, 0.3) == view_map._colour(1.0, 1.0)


@pytest.mark.parametrize(('force_n', 'cell'), [(0.004, ' .  '), (0.126, '0.13'), (12.34, '12.3'), (-0.126, '-.13')])
def test_a_cell_holds_four_characters(force_n: float, cell: str) -> None:
    assert view_map._cell(force_n) == cell


def test_force_error_place_provenance_and_milliseconds_of_each_stage_are_shown() -> None:
    text = '\n'.join(drawn(pressed()))
    assert '0.250 N  true  0.500 N  error -0.250 N' in text
    assert '( +0.00,  +0.00) mm  true ( +3.00,  +4.00) mm  off by 5.00 mm' in text
    assert 'paper (abc)  gel soft  rest def' in text
    for stage, shown in (('acquire', '1.00'), ('flow', '2.00'), ('features', '3.00'), ('predict', '0.50')):
        assert f'{stage:<11} {shown:>6}' in text
    assert f'{"transport":<11} {"3.50":>6}' in text
    assert f'{"end to end":<11} {"10.00":>6}' in text


def test_status_and_reasons_are_shown_in_words() -> None:
    state = ViewState()
    kind = types.ForceDistribution
    state.add_force(received(force(10, status=kind.STATUS_INVALID, reasons=kind.REASON_DARK_IMAGE), 20))
    assert 'INVALID: dark image' in drawn(state)[0]


def test_without_a_force_a_contact_is_unknown() -> None:
    state, kind = ViewState(), types.ForceDistribution
    state.add_force(received(force(10, (math.nan,) * 4, status=kind.STATUS_INVALID), 20))
    assert 'contact unknown' in view_render.line(state.snapshot(30 * MS))


def test_forces_that_stop_are_reported() -> None:
    assert 'no force for 2.5 s, the last was OK' in drawn(pressed(), now_ms=2520)[0]


def test_who_complains_is_reported_beside_a_force_that_is_old_and_not_beside_a_new_one() -> None:
    state = pressed()
    reports = diagnostics(('camera: camera', 1, 'recording ended'), ('flow_features: pictures', 0, '640x480'))
    state.add_diagnostics(received(reports, 25))
    assert 'recording ended' not in view_render.line(state.snapshot(30 * MS))
    assert view_render.line(state.snapshot(2520 * MS)).endswith('/camera: camera: recording ended')


def test_a_map_too_wide_for_numbers_is_drawn_in_colours_alone() -> None:
    fine = types.ForceDistribution(rows=40, cols=40, normal_force=np.full(1600, 0.5, np.float32))
    state = ViewState()
    state.add_force(received(fine, 20))
    lines = drawn(state)
    assert len(lines) < 40
    assert '0.50' not in '\n'.join(lines[:20])


def test_pooling_keeps_the_largest_force() -> None:
    newtons = np.zeros((30, 30))
    newtons[29, 29] = 0.7
    pooled = view_map._pooled(newtons)
    assert pooled.shape == (15, 15)
    assert pooled[14, 14] == 0.7


def test_without_an_estimator_the_view_says_how_to_start_one() -> None:
    text = view_render.waiting(ViewState('/left').snapshot(0))
    assert text == ('no force yet: /left/force_distribution has no publisher; start a sensor with: tactile launch live')


def test_while_waiting_the_last_diagnostics_are_reported_worst_first() -> None:
    state = ViewState()
    state.estimators = ('/force_estimator',)
    state.add_diagnostics(received(diagnostics(('flow: rest', 1, 'no rest image'), ('camera: camera', 2, 'not found'))))
    assert view_render.waiting(state.snapshot(0)) == (
        'no force yet: /force_estimator is waiting; is a camera running? '
        'Diagnostics: /camera: camera: not found; /flow: rest: no rest image'
    )


def test_the_plain_line_holds_the_same_numbers() -> None:
    line = view_render.line(pressed().snapshot(30 * MS))
    assert 'force  0.250 N  true  0.500 N  error -0.250 N' in line
    assert 'capture to here p50 10.00 p99 10.00 ms' in line
    assert line.endswith('OK')


def test_a_line_counts_the_contacts_beyond_the_one_that_it_places() -> None:
    first, second = (types.Contact(position=types.Point(x=x, y=0.0, z=0.0), force=0.1) for x in (0.001, 0.008))
    state = ViewState()
    state.add_force(received(force(10, contact_mm=(1.0, 0.0), contacts=[first, second]), 20))
    assert 'contact ( +1.00,  +0.00) mm and 1 more' in view_render.line(state.snapshot(30 * MS))


def test_shear_torsion_and_explanation_are_reported_where_they_are_known() -> None:
    state = ViewState()
    state.add_force(received(ring(10 * MS)[0], 20))
    shear = 'shear 0.600±0.020 N →  torsion 4.0±0.1 N mm  explained by field'
    assert f'acting   {shear}' in drawn(state)
    assert shear in view_render.line(state.snapshot(30 * MS))


def test_a_model_that_knows_normal_forces_alone_tells_no_shear() -> None:
    forces = conversions.force_fields(np.ones((9, 9), np.float32), BinGrid(9, 9, 36.0, 36.0))
    state = ViewState()
    state.add_force(received(types.ForceDistribution(**forces), 20))
    assert 'shear' not in '\n'.join(drawn(state))
    assert 'shear' not in view_render.line(state.snapshot(30 * MS))


def test_the_summary_tells_frames_latency_drops_and_errors() -> None:
    state = pressed()
    state.add_truth(received(force(26, (0.0, 0.5, 0.0, 0.0), (3.0, 4.0)), 27, 2))
    state.add_force(received(force(26, (0.5, 0.0, 0.0, 0.0), (0.0, 0.0)), 36, 3))
    text = view_render.summary(state.summary(100 * MS))
    assert '2 frames in 0.1 s, the first after 0.0 s' in text
    assert '1 lost in transit' in text
    # errors -0.25 and 0 N: sqrt(0.0625 / 2) = 0.1768
    assert 'RMSE 0.1768 N over 2 frames' in text
    assert 'peak in the true bin: 50.0% of 2 frames in contact' in text


def test_the_summary_of_nothing_says_what_is_missing() -> None:
    assert 'no force yet' in view_render.summary(ViewState().summary(100 * MS))


def test_the_summary_without_truth_says_so() -> None:
    state = ViewState()
    state.add_force(received(force(10), 20))
    assert view_render.summary(state.summary(100 * MS)).endswith('no true force for comparison')


def test_the_picture_fits_a_terminal_of_80_columns() -> None:
    file = io.StringIO()
    nine = types.ForceDistribution(rows=9, cols=9, normal_force=np.full(81, 0.5, np.float32))
    state = ViewState()
    state.add_force(received(nine, 20))
    console = Console(file=file, width=80, height=24, color_system=None)
    console.print(view_render.picture(state.snapshot(30 * MS)))
    lines = file.getvalue().splitlines()
    assert max(len(line) for line in lines) <= 80
    assert len(lines) <= 24
    assert not any('…' in line for line in lines[:12])


def test_no_number_is_shown_where_none_was_measured() -> None:
    assert view_render.milliseconds(math.nan) == '-'
