"""The calibrations of a lab: kept in one file, with what the drift monitor said since, and which is due."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tactile_nodes.cli.main import main
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.gel_list import NS_PER_DAY, Calibration, GelList, list_file

DAY = NS_PER_DAY
SEVEN = Calibration('a1', gel='gel-7', file='gel-7.safetensors', made_ns=10 * DAY, presses=100, error_n=0.012)
EIGHT = Calibration('b2', gel='gel-8', made_ns=20 * DAY)


@pytest.fixture
def gels(tmp_path: Path) -> GelList:
    return GelList(tmp_path / 'lab' / 'gels.sqlite')


def test_what_was_added_is_there_the_newest_first(gels: GelList) -> None:
    assert gels.calibrations() == []
    gels.add(SEVEN)
    gels.add(EIGHT)
    assert GelList(gels.file).calibrations() == [EIGHT, SEVEN]


def test_the_same_model_added_again_takes_its_own_place(gels: GelList) -> None:
    gels.add(Calibration('a1', gel='wrong'))
    gels.add(SEVEN)
    assert gels.calibrations() == [SEVEN]


def test_a_model_added_again_keeps_what_is_not_given_anew(gels: GelList, tmp_path: Path) -> None:
    file, copy = tmp_path / 'gel-7.safetensors', tmp_path / 'copy.safetensors'
    file.touch()
    gels.add(replace(SEVEN, sensor='finger_2', file=str(file)))
    gels.look('a1', 'ageing', 'calibrate again', 15 * DAY)
    before = gels.calibrations()
    gels.add(replace(SEVEN, file=str(copy), made_ns=30 * DAY))
    assert gels.calibrations() == before
    gels.add(replace(SEVEN, sensor='finger_3', file=str(copy)))
    assert gels.calibrations() == [replace(before[0], sensor='finger_3')]


def test_a_file_that_is_gone_or_holds_another_model_now_gives_way_to_the_one_that_is_added(
    gels: GelList, tmp_path: Path
) -> None:
    gels.add(SEVEN)
    again = tmp_path / 'again.safetensors'
    again.touch()
    gels.add(replace(SEVEN, file=str(again)))
    assert [each.file for each in gels.calibrations()] == [str(again)]
    gels.add(replace(EIGHT, file=str(again)))
    gels.add(replace(SEVEN, file='copy.safetensors'))
    assert {each.gel: each.file for each in gels.calibrations()} == {'gel-7': 'copy.safetensors', 'gel-8': str(again)}


@pytest.mark.parametrize('days', ['nan', '-1'])
def test_an_age_that_is_no_number_of_days_is_refused(days: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(['gels', '--after', days])
    assert '--after' in capsys.readouterr().err


def test_what_the_drift_monitor_said_last_is_kept_and_older_words_are_not(gels: GelList) -> None:
    gels.add(SEVEN)
    assert gels.look('a1', 'ageing', 'calibrate again', 15 * DAY)
    assert gels.look('a1', 'valid', '', 12 * DAY)
    (found,) = gels.calibrations()
    assert (found.level, found.remedy, found.looked_ns) == ('ageing', 'calibrate again', 15 * DAY)


def test_a_state_of_the_future_does_not_hide_those_after_it(gels: GelList) -> None:
    """A camera whose clock was ten days ahead; later its clock was set, and later still an old bag was read."""
    gels.add(SEVEN)
    today = GelList(gels.file, SteppedClock(20 * DAY))
    for level, day in (('invalid', 30), ('ageing', 19), ('valid', 18)):
        assert today.look('a1', level, '', day * DAY)
    (found,) = gels.calibrations()
    assert (found.level, found.looked_ns) == ('ageing', 19 * DAY)


def test_a_model_that_is_not_on_the_list_is_not_put_there_by_a_look(gels: GelList) -> None:
    assert not gels.look('a1', 'valid', '', 0)
    assert not gels.file.exists()
    gels.add(EIGHT)
    assert not gels.look('a1', 'valid', '', 0)
    assert gels.calibrations() == [EIGHT]


def test_what_is_forgotten_is_gone(gels: GelList) -> None:
    assert not gels.forget('a1')
    gels.add(SEVEN)
    assert gels.forget('a1')
    assert gels.calibrations() == []


@pytest.mark.parametrize(
    ('level', 'now_days', 'due'),
    [
        ('', 11, ''),
        ('valid', 100, ''),
        ('valid', 101, 'older than 90 days'),
        ('ageing', 11, 'ageing: calibrate again'),
        ('invalid', 101, 'ageing: calibrate again'),
    ],
)
def test_a_calibration_is_due_when_it_drifted_or_is_old(level: str, now_days: int, due: str) -> None:
    found = Calibration('a1', made_ns=10 * DAY, level=level, remedy='ageing: calibrate again')
    assert found.due(now_days * DAY, 90) == due


def test_a_calibration_that_has_a_newer_one_is_not_due_by_its_age(
    gels: GelList, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is if the drift monitor found so: a sensor may still use it. A model without a gel has no newer one."""
    drifted = replace(SEVEN, model_id='c3', made_ns=5 * DAY, level='invalid', remedy='other markers')
    renewed = replace(SEVEN, model_id='d4', made_ns=30 * DAY)
    for each in (SEVEN, drifted, renewed, EIGHT, Calibration('e5', made_ns=2 * DAY), Calibration('f6', made_ns=DAY)):
        gels.add(each)
    monkeypatch.setenv('TACTILE_GELS', str(gels.file))
    assert main(['gels', '--json']) == 0
    due = {each['model_id']: each['due'] for each in json.loads(capsys.readouterr().out)}
    old = 'older than 90 days'
    assert due == {'d4': old, 'b2': old, 'a1': '', 'c3': 'other markers', 'e5': old, 'f6': old}
    assert main(['gels']) == 0
    assert capsys.readouterr().out.count(old) == 4


@pytest.mark.parametrize(
    ('entry', 'value'), [('made_ns', 'soon'), ('made_ns', 1e30), ('looked_ns', None), ('error_n', b'0')]
)
def test_an_impossible_entry_is_one_sentence_that_removes_it(
    gels: GelList, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, entry: str, value: object
) -> None:
    gels.add(SEVEN)
    gels.add(EIGHT)
    with sqlite3.connect(gels.file) as database:
        database.execute(f"UPDATE calibrations SET {entry} = ? WHERE model_id = 'a1'", (value,))
    database.close()
    monkeypatch.setenv('TACTILE_GELS', str(gels.file))
    assert main(['gels']) == 1
    said = f'has an impossible {entry} of model a1, {value!r}; remove it: tactile gels forget a1\n'
    assert capsys.readouterr().err.endswith(said)
    assert main(['gels', 'forget', 'a1']) == 0
    assert gels.calibrations() == [EIGHT]


def test_one_without_a_date_is_not_called_old() -> None:
    assert Calibration('a1').due(1000 * DAY, 90) == ''


@pytest.mark.parametrize('content', [b'no database at all', b''])
def test_another_file_is_one_sentence(gels: GelList, content: bytes) -> None:
    gels.file.parent.mkdir()
    gels.file.write_bytes(content)
    with pytest.raises(ConfigurationError, match='not a usable list of calibrations'):
        gels.calibrations()


@pytest.mark.parametrize('use', [GelList.calibrations, lambda gels: gels.look('a1', 'valid', '', 1),
                                 lambda gels: gels.forget('a1')])  # fmt: skip
def test_a_path_that_cannot_be_looked_at_is_one_sentence(use: Callable[[GelList], object], tmp_path: Path) -> None:
    """As in a home folder that a service may not enter, where the drift monitor ended; a long name does the same."""
    with pytest.raises(ConfigurationError, match=r'not a usable list of calibrations .*set TACTILE_GELS to another'):
        use(GelList(tmp_path / ('x' * 300)))


def test_a_file_that_defines_more_than_tables_is_refused(gels: GelList) -> None:
    gels.add(SEVEN)
    with sqlite3.connect(gels.file) as database:
        database.execute('CREATE TRIGGER more AFTER INSERT ON calibrations BEGIN DELETE FROM calibrations; END')
    database.close()
    with pytest.raises(ConfigurationError, match='objects other than tables'):
        gels.add(EIGHT)


def test_the_file_is_where_the_environment_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('TACTILE_GELS', str(tmp_path / 'own.sqlite'))
    assert list_file() == tmp_path / 'own.sqlite'
    monkeypatch.delenv('TACTILE_GELS')
    monkeypatch.setenv('XDG_DATA_HOME', str(tmp_path))
    assert list_file() == tmp_path / 'tactile_nodes' / 'gels.sqlite'
