"""Plans: their points, numbers and names."""

from __future__ import annotations

import codecs
import itertools
import math
from pathlib import Path

import pytest

from tactile_nodes import paths
from tactile_nodes.collection.plan.plan import (
    Plan,
    PlanSettings,
    Point,
    load_plan_settings,
    make_plan,
    numbered,
    plan_path,
    read_points,
)
from tactile_nodes.errors import ConfigurationError

PLANS = paths.share_directory() / 'config' / 'plans'


def test_plan_of_the_paper_has_10952_presses_from_minus_to_plus_13_5_mm() -> None:
    plan = make_plan(load_plan_settings(PLANS / 'paper.yaml'))
    assert len(plan.points) == 37 * 37 * 8 == 10952
    assert plan.box_mm == (-13.5, -13.5, 13.5, 13.5)
    assert sorted({point.depth_mm for point in plan.points}) == [0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0]


def test_every_plan_that_ships_can_be_made() -> None:
    for file in PLANS.glob('*.yaml'):
        assert make_plan(load_plan_settings(file)).points


def test_plan_is_found_by_its_name_and_by_its_file(tmp_path: Path) -> None:
    own = tmp_path / 'paper.yaml'
    own.write_text('kind: grid\n')
    assert plan_path('paper') == PLANS / 'paper.yaml'
    assert plan_path(str(own)) == own


def test_plan_that_is_nowhere_is_reported_with_those_that_ship() -> None:
    with pytest.raises(ConfigurationError, match=r"no plan 'papr'; give a YAML file, or a shipped one: .*paper,"):
        plan_path('papr')


def test_presses_are_numbered_from_one() -> None:
    plan = numbered([(0.0, 0.0, 1.0), (1.0, 0.0, 1.0)])
    assert plan.points == (Point(1, 0.0, 0.0, 1.0), Point(2, 1.0, 0.0, 1.0))


def test_plan_is_named_by_its_points_alone() -> None:
    # printf '1 0 0 1000\n2 1500 -250 500' | sha256sum
    plan = numbered([(0.0, 0.0, 1.0), (1.5, -0.25, 0.5)])
    assert plan.plan_id == '75201074f574'
    assert numbered([(0.0, 0.0, 1.0), (1.5, -0.25, 0.501)]).plan_id != plan.plan_id


def test_random_plan_is_the_same_every_time_and_another_for_another_seed() -> None:
    same = [make_plan(PlanSettings(kind='random', count=20, seed=seed)).plan_id for seed in (1, 1, 2)]
    assert same[0] == same[1] != same[2]


@pytest.mark.parametrize('text', ['', '# my plan\n'])
def test_a_plan_without_entries_is_not_the_papers(text: str, tmp_path: Path) -> None:
    """A full disk leaves such a file, and the paper's plan takes 13 hours."""
    (tmp_path / 'plan.yaml').write_text(text)
    with pytest.raises(ConfigurationError, match=r'plan\.yaml has no entries'):
        load_plan_settings(tmp_path / 'plan.yaml')


def test_list_of_points_is_read(tmp_path: Path) -> None:
    (tmp_path / 'points.csv').write_text('# by hand\nx_mm,y_mm,depth_mm\n1.0, 2.0, 0.5\n-1, 0, 1\n')
    (tmp_path / 'plan.yaml').write_text('kind: list\nfile: points.csv\n')
    plan = make_plan(load_plan_settings(tmp_path / 'plan.yaml'))
    assert [point[1:] for point in plan.points] == [(1.0, 2.0, 0.5), (-1.0, 0.0, 1.0)]


def test_a_list_that_a_spreadsheet_has_saved_is_read(tmp_path: Path) -> None:
    """Excel's "CSV UTF-8" begins with a byte order mark, and its lines end as on Windows."""
    (tmp_path / 'points.csv').write_bytes(codecs.BOM_UTF8 + b'x_mm,y_mm,depth_mm\r\n1,2,0.5\r\n')
    (tmp_path / 'plan.yaml').write_bytes(codecs.BOM_UTF8 + b'kind: list\r\nfile: points.csv\r\n')
    plan = make_plan(load_plan_settings(tmp_path / 'plan.yaml'))
    assert [point[1:] for point in plan.points] == [(1.0, 2.0, 0.5)]


@pytest.mark.parametrize(
    'text',
    [
        'x_mm;y_mm;depth_mm\n1,5;-2;0,25\n',
        'x_mm\ty_mm\tdepth_mm\n1,5\t-2\t0,25\n',
        '# x, y\nx_mm;y_mm;depth_mm\n1.5;-2;0.25',
    ],
)
def test_a_list_with_semicolons_or_tabs_and_decimal_commas_is_read(text: str, tmp_path: Path) -> None:
    """As a spreadsheet saves it where the decimal separator is a comma."""
    (tmp_path / 'points.csv').write_text(text)
    assert read_points(tmp_path / 'points.csv') == [(1.5, -2.0, 0.25)]


@pytest.mark.parametrize(
    'row', ['1,2', '1,2,-0.5', '1,2,nan', '1,2,1e308', '1,2,1\n1,2,1', '1,2,deep', '', '1,2,"' + '0.5\n' * 50_000]
)
def test_list_that_holds_something_else_is_refused(tmp_path: Path, row: str) -> None:
    (tmp_path / 'points.csv').write_text(f'x_mm,y_mm,depth_mm\n{row}\n')
    with pytest.raises(ConfigurationError):
        make_plan(PlanSettings(kind='list', file=str(tmp_path / 'points.csv')))


def test_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    """Read column by column this is x 1, y 5, depth 2, and not x 1.5, y 2, depth 0.5."""
    (tmp_path / 'points.csv').write_text('x_mm,y_mm,depth_mm\n1,5,2,0,0,5\n')
    with pytest.raises(ConfigurationError, match=r'point 1 of .*points\.csv has more values than columns'):
        read_points(tmp_path / 'points.csv')


def test_empty_values_after_the_last_column_are_none(tmp_path: Path) -> None:
    """As a spreadsheet saves a table beside which something was deleted."""
    (tmp_path / 'points.csv').write_text('x_mm,y_mm,depth_mm\n1.5,2,0.5,,\n')
    assert read_points(tmp_path / 'points.csv') == [(1.5, 2.0, 0.5)]


def test_a_list_without_the_names_of_its_columns_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'points.csv').write_text('1,2,0.5\n-1,0,1\n')
    with pytest.raises(ConfigurationError, match='has no x_mm, y_mm and depth_mm'):
        make_plan(PlanSettings(kind='list', file=str(tmp_path / 'points.csv')))


def test_plan_without_points_is_refused() -> None:
    with pytest.raises(ConfigurationError, match='no points'):
        Plan(())


def test_places_of_a_spread_plan_lie_apart_from_its_first_few_on() -> None:
    """Of a square of 27 mm nine places can be 13.5 mm apart, four at corners; those of chance are 1 to 3 mm apart."""
    points = make_plan(PlanSettings(kind='spread', count=9, reach_mm=13.5)).points
    apart = [math.dist(a[1:3], b[1:3]) for a, b in itertools.combinations(points, 2)]
    assert min(apart) > 0.8 * 13.5


def test_the_first_presses_of_a_spread_plan_are_the_same_however_many_follow() -> None:
    few, many = (make_plan(PlanSettings(kind='spread', count=count)).points for count in (10, 30))
    assert many[:10] == few


def test_a_spread_plan_of_too_many_places_says_what_to_use() -> None:
    with pytest.raises(ValueError, match='use random for 3000'):
        PlanSettings(kind='spread', count=3000)
