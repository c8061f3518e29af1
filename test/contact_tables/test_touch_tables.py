from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes import paths
from tactile_nodes.contact_tables import touch_tables
from tactile_nodes.contact_tables.gel_tables import load_gel
from tactile_nodes.contact_tables.touch_bodies import body_of
from tactile_nodes.contact_tables.touch_tables import (
    Contact,
    first_solved,
    ready_contacts,
    solved_contact,
    usual_contact,
)
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.track import Way


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))


def test_the_usual_contacts_ship_solved_for_all_gels_as_thick():
    paper, stiff = (ready_contacts(load_gel(name)) for name in ('paper', 'stiff'))
    assert list(paper) == list(stiff) == ['ring', 'edge', 'two']
    gel = load_gel('paper')
    for table in paper.values():
        assert table.force[-1, 2] * gel.shear_modulus_mpa == pytest.approx(2.0, rel=0.01)
        assert table.presses == 3
        assert np.hypot(*table.force[-1, :2]) > 0.3 * table.force[-1, 2]  # dragged
    assert ready_contacts(load_gel('thin')) == {}


def test_usual_contacts_that_are_wider_than_the_gel_are_left_out():
    """The edge is 20 mm wide, and a gel as thick as the paper's 19 mm."""
    assert list(ready_contacts(dataclasses.replace(load_gel('paper'), height_mm=19.0))) == ['ring', 'two']


def test_a_contact_is_solved_once_and_then_known(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(touch_tables, 'CELLS', 40)
    monkeypatch.setattr(touch_tables, 'CELL_MM', 0.8)
    gel, steps = load_gel('paper'), list[tuple[int, int]]()
    contact = Contact('ball', force_n=0.5, drag_mm=0.0)
    first = solved_contact(gel, contact, lambda done, of: steps.append((done, of)))
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    again = solved_contact(gel, contact, lambda done, of: steps.append((done, of)))
    assert len(steps) == 4
    np.testing.assert_allclose(again.coefficients, first.coefficients, atol=1e-3)


@pytest.mark.parametrize('content', [b'', b'PK\x03\x04 and no more', bytes(4096)])
def test_a_damaged_table_of_the_cache_counts_as_none(content: bytes):
    """A cut of power leaves an empty file or zeros under the right name; every later start would end there."""
    file = paths.cache_directory() / 'touches' / 'damaged.npz'
    file.parent.mkdir()
    file.write_bytes(content)
    assert touch_tables.known_table('damaged') is None


def test_the_usual_contacts_need_no_cache(monkeypatch: pytest.MonkeyPatch):
    """Below a device no folder can be made, as little as in a home folder that a service may only read."""
    monkeypatch.setenv('XDG_CACHE_HOME', '/dev/null')
    assert list(ready_contacts(load_gel('paper'))) == ['ring', 'edge', 'two']
    assert ready_contacts(load_gel('thin')) == {}


def test_the_first_force_that_can_be_solved_is_taken_and_needs_no_cache(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('XDG_CACHE_HOME', '/dev/null')
    monkeypatch.setattr(touch_tables, 'CELLS', 40)
    monkeypatch.setattr(touch_tables, 'CELL_MM', 0.8)
    too_hard, light = (Way(force_mm2=force, press_stages=1) for force in (1e5, 4.5))
    table = first_solved(load_gel('paper'), body_of('ball'), [too_hard, light])
    assert table.force[-1, 2] == pytest.approx(4.5, rel=0.02)


def test_a_description_says_what_presses_and_how(tmp_path: Path):
    file = tmp_path / 'pair.yaml'
    file.write_text(
        'body: [{body: tip, at_mm: [2.0, 0.0]}, {body: pad.npy, raised_mm: 0.1}]\nforce_n: 1.5\ntilt_deg: [0, 1.0]\n'
    )
    contact = Contact.named(str(file))
    assert (contact.force_n, contact.tilt_deg, contact.friction) == (1.5, (0.0, 1.0), 0.6)
    assert contact.body[1]['body'] == str(tmp_path / 'pad.npy')
    np.save(tmp_path / 'pad.npy', np.zeros((11, 11)))
    body = body_of(contact.body)
    height = body.under(np.array([2.0, 0.0]), np.array([0.0, 0.0]))[0]
    assert height == pytest.approx([0.0, 0.1], abs=1e-6)


def test_the_description_that_ships_is_two_fingers_a_little_apart_in_height():
    contact = Contact.named(str(paths.share_directory() / 'config' / 'contacts' / 'two_fingers.yaml'))
    left, right, between = body_of(contact.body).under(np.array([-4.5, 4.5, 0.0]), np.zeros(3))[0]
    assert (left, right) == pytest.approx((0.0, 0.1), abs=1e-6)
    assert between > 1.5
    assert contact.twist_deg == 5.0


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('force_n: 2.0\n', 'does not describe a contact; it needs at least an entry like: body: ring'),
        ('body: ring\nfroce_n: 2.0\n', "a contact has no 'froce_n'; it has: body, tilt_deg, force_n"),
        ('body: ring\nforce_n: much\n', "'force_n' must be like 2.0, got 'much'"),
        ('body: ring\ntilt_deg: 3\n', r"'tilt_deg' must be like \[0.0, 0.0\], got 3"),
        ('body: ring\nforce_n: -1.0\n', r"contact.yaml: a contact's 'force_n' must be from 0.001 to 100, got -1"),
        ('body: ring\ntilt_deg: [0, 200]\n', r"'tilt_deg' must be from -180 to 180, got \(0.0, 200.0\)"),
        ('body: [\n', 'cannot read the contact'),
    ],
)
def test_a_description_that_says_nonsense_is_refused(tmp_path: Path, text: str, said: str):
    file = tmp_path / 'contact.yaml'
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        Contact.named(str(file))


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('rign', "there is no contact 'rign'; give one of: tip, ball, .*, ball:5 or .* a live launch, mixed$"),
        (
            'ball:0',
            '^ball:0 is not a body: ball: must be followed by a radius in mm above 0 and up to 20, like ball:1.5$',
        ),
        ('missing.stl', r'cannot read the body missing.stl \(No such file or directory\)'),
        ('text.npy', 'holds no array of heights'),
        ('text.obj', 'holds no triangles'),
        ('text.stl', r'it is not text, and its length is not the \d+ bytes that its header gives'),
    ],
)
def test_bodies_that_are_none_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str):
    monkeypatch.chdir(tmp_path)
    for file in ('text.npy', 'text.obj', 'text.stl'):
        (tmp_path / file).write_text('no numbers\n')
    with pytest.raises(ConfigurationError, match=said):
        solved_contact(load_gel('paper'), Contact.named(name))


def test_bodies_are_named_by_their_radius_as_in_every_command():
    two = body_of([{'body': 'ball:5'}, {'body': 'punch:1.5', 'at_mm': [8.0, 0.0]}])
    heights = two.under(np.array([0.0, 2.0, 6.6, 9.4]), np.zeros(4))[0]
    np.testing.assert_allclose(heights, [0.0, 5 - 21**0.5, 0.0, 0.0], atol=1e-3)


def test_meshes_whose_names_are_no_utf8_are_read_and_one_cut_short_is_reported(tmp_path: Path):
    trimesh = pytest.importorskip('trimesh')
    box, plain, binary = trimesh.creation.box((6.0, 4.0, 2.0)), tmp_path / 'box.obj', tmp_path / 'cut.stl'
    plain.write_bytes('o Gehäuse\n'.encode('latin-1') + box.export(file_type='obj').encode())
    text = tmp_path / 'text.stl'
    text.write_bytes(box.export(file_type='stl_ascii').encode().replace(b'solid', b'solid Geh\xe4use', 1))
    binary.write_bytes(box.export(file_type='stl')[:-50])
    for file in (plain, text):
        assert body_of(str(file)).reach_mm == pytest.approx(3.0, abs=0.11)
    with pytest.raises(
        ConfigurationError, match=r'cut.stl cannot be read as a mesh \(.* 684 bytes that its header gives\)'
    ):
        body_of(str(binary))


@pytest.mark.parametrize(
    ('body', 'said'),
    [
        ([], 'a list of bodies needs at least one'),
        (['ring'], r"a body of a list must be like \{body: ring, at_mm: .*, got 'ring'"),
        ([{'body': 'ring', 'up_mm': 3.0}], 'a body of a list must be like'),
        ([{'body': 'ring', 'at_mm': [1.0]}], 'a body of a list must be like'),
        ([{'body': 'ring', 'at_mm': [1e9, 0.0]}], 'within 40 mm'),
    ],
)
def test_a_list_of_bodies_says_what_each_is_and_where(body: object, said: str):
    with pytest.raises(ConfigurationError, match=said):
        body_of(body)


def forged(header: bytes, version: bytes = b'\x01\x00') -> bytes:
    """The start of an .npy file with any header, and 64 bytes of numbers."""
    return b'\x93NUMPY' + version + len(header).to_bytes(2, 'little') + header + bytes(64)


@pytest.mark.parametrize(
    'data',
    [
        forged(b"{'descr': '<f8', 'fortran_order': False, 'shape': (1048576, 1048576)}"),
        forged(b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3)}"),
        forged(b"{'descr': '<f8', 'fortran_order': False, 'shape': (1" + b'0' * 4000 + b', 9)}'),
        forged(b"{'descr': '|O', 'fortran_order': False, 'shape': (2, 2)}"),
        forged(b'((('),
        forged(b'-' * 9000 + b'1'),
        forged(b"{'descr': '<f8', 'fortran_order': False, 'shape': (2, 2)}", version=b'\x03\x00'),
        b'',
        b'PK\x05\x06' + bytes(18),
    ],
    ids=['8 TiB', '72 of 64 bytes', 'digits', 'objects', 'open', 'nested', 'version', 'empty', 'zip'],
)
def test_heights_that_are_fewer_than_their_header_says_are_refused(tmp_path: Path, data: bytes):
    (tmp_path / 'forged.npy').write_bytes(data)
    with pytest.raises(ConfigurationError, match='holds no array of heights, or is shorter than its header says;'):
        body_of(str(tmp_path / 'forged.npy'))


@pytest.mark.parametrize('order', ['C', 'F'])
def test_heights_are_read_as_numpy_keeps_them(tmp_path: Path, order: str):
    heights = np.zeros((5, 5))
    heights[1, 3] = 0.001
    np.save(tmp_path / 'pad.npy', np.asarray(heights, order=order))
    assert np.argwhere(body_of(str(tmp_path / 'pad.npy')).height_mm > 0).tolist() == [[1, 3]]


@pytest.mark.parametrize(
    ('tilt_deg', 'raised'), [((5.0, 0.0), (0.0, 2.0)), ((0.0, 5.0), (-2.0, 0.0)), ((3.0, -2.0), (2.0, 2.0))]
)
def test_heights_and_a_mesh_of_one_body_are_tilted_alike(
    tmp_path: Path, tilt_deg: tuple[float, float], raised: tuple[float, float]
):
    """By the right-hand rule, with z away from the gel: about x the side of +y rises, about y that of -x.

    Rims are given to a cell of 0.1 mm, which is 0.009 mm of height at 5 degrees.
    """
    box = pytest.importorskip('trimesh').creation.box((6.0, 6.0, 2.0))
    box.export(tmp_path / 'box.stl')
    heights = np.full((81, 81), np.nan)
    heights[10:71, 10:71] = 0.0
    np.save(tmp_path / 'box.npy', heights)
    mesh, from_heights = (body_of(str(tmp_path / name), tilt_deg) for name in ('box.stl', 'box.npy'))
    x, y = np.array([-2.0, 2.0, 0.0, 0.0]), np.array([0.0, 0.0, -2.0, 2.0])
    np.testing.assert_allclose(from_heights.under(x, y)[0], mesh.under(x, y)[0], atol=0.01)
    up, down = (from_heights.under(np.array(sign * raised[0]), np.array(sign * raised[1]))[0] for sign in (1.0, -1.0))
    assert up > down + 0.1


def test_a_body_of_heights_is_tilted_a_little_only():
    with pytest.raises(ConfigurationError, match=r'ring can be tilted by at most 20 degrees, got \[0.0, 90.0\]'):
        body_of('ring', (0.0, 90.0))


def test_a_body_wider_than_the_gel_is_refused_with_both_sizes(tmp_path: Path):
    np.save(tmp_path / 'plate.npy', np.zeros((361, 361)))
    with pytest.raises(ConfigurationError, match='plate is 36 mm wide about its origin, but the gel only 32 mm'):
        solved_contact(load_gel('paper'), Contact(str(tmp_path / 'plate.npy')))
    np.save(tmp_path / 'field.npy', np.zeros((2500, 2500), np.float16))
    with pytest.raises(ConfigurationError, match='is 250 mm wide, at most 40 is allowed; cut it'):
        body_of(str(tmp_path / 'field.npy'))


def test_a_contact_of_a_gel_as_hard_as_another_presses_in_proportion():
    assert usual_contact(load_gel('stiff'), 'ring').force_n == pytest.approx(18 * 0.167)
