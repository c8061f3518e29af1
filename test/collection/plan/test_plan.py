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


@pytest.mark.parametrize(
    ('points', 'mark', 'end'),
    [
        ('# by hand\nx_mm,y_mm,depth_mm\n1.0, 2.0, 0.5\n-1, 0, 1\n', b'', '\n'),
        ('x_mm,y_mm,depth_mm\n1,2,0.5\n-1,0,1\n', codecs.BOM_UTF8, '\r\n'),
    ],
    ids=['by hand', 'CSV UTF-8 of Excel'],  # which begins with a byte order mark, with lines as on Windows
)
def test_list_of_points_is_read(tmp_path: Path, points: str, mark: bytes, end: str) -> None:
    for name, text in (('points.csv', points), ('plan.yaml', 'kind: list\nfile: points.csv\n')):
        (tmp_path / name).write_bytes(mark + text.replace('\n', end).encode())
    plan = make_plan(load_plan_settings(tmp_path / 'plan.yaml'))
    assert [point[1:] for point in plan.points] == [(1.0, 2.0, 0.5), (-1.0, 0.0, 1.0)]


@pytest.mark.parametrize(
    'text',
    [
        'x_mm;y_mm;depth_mm\n1,5;-2;0,25\n',
        'x_mm\ty_mm\tdepth_mm\n1,5\t-2\t0,25\n',
        '# x, y\nx_mm;y_mm;depth_mm\n1.5;-2;0.25',
        'x_mm,y_mm,depth_mm\n1.5,-2,0.25,,\n',  # a table beside which something was deleted
    ],
)
def test_a_list_is_read_as_a_spreadsheet_saves_it(text: str, tmp_path: Path) -> None:
    """As a spreadsheet saves it where the decimal separator is a comma."""
    (tmp_path / 'points.csv').write_text(text)
    assert read_points(tmp_path / 'points.csv') == [(1.5, -2.0, 0.25)]


HEAD = 'x_mm,y_mm,depth_mm\n'


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        *((f'{HEAD}{row}\n', None) for row in ('1,2', '1,2,-0.5', '1,2,nan', '1,2,1e308', '1,2,1\n1,2,1', '1,2,deep')),
        (f'{HEAD}\n', None),
        (HEAD + '1,2,"' + '0.5\n' * 50_000, None),
        # Decimal commas between commas: read column by column this is x 1, y 5, depth 2, and not x 1.5, y 2, depth 0.5.
        (f'{HEAD}1,5,2,0,0,5\n', r'point 1 of .*points\.csv has more values than columns'),
        ('1,2,0.5\n-1,0,1\n', 'has no x_mm, y_mm and depth_mm'),
    ],
)
def test_list_that_holds_something_else_is_refused(tmp_path: Path, text: str, reason: str | None) -> None:
    (tmp_path / 'points.csv').write_text(text)
    with pytest.raises(ConfigurationError, match=reason):
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
