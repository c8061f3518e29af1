"""What a package index and pip get: names, links and files."""

from __future__ import annotations

import email
import fcntl
import importlib.metadata
import re
import subprocess
import sys
import tarfile
from email.message import Message
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
LINK = re.compile(r'\[[^]]*]\(([^)\s]+)\)')


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A source distribution, unpacked. One after another makes it, since each gathers its files in the checkout."""
    folder = tmp_path_factory.mktemp('sdist')
    made = ['egg_info', '-e', str(folder), 'sdist', '-q', '--formats=tar', '-d', str(folder)]
    with (ROOT / 'setup.py').open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        subprocess.run([sys.executable, 'setup.py', '-q', *made], cwd=ROOT, check=True, capture_output=True)
    (archive,) = folder.glob('*.tar')
    with tarfile.open(archive) as opened:
        opened.extraction_filter = getattr(
            tarfile, 'data_filter', None
        )  # Python before 3.11.4 has none, and no argument
        opened.extractall(folder)
    return folder / archive.name.removesuffix('.tar')


@pytest.fixture(scope='module')
def metadata(source: Path) -> Message:
    return email.message_from_string((source / 'PKG-INFO').read_text(encoding='utf-8'))


def kept_files() -> set[Path]:
    """The files of the checkout, or of the source distribution that this test runs in."""
    listed = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode == 0:
        return {Path(name) for name in listed.stdout.split('\0') if name and (ROOT / name).exists()}
    return {path.relative_to(ROOT) for path in (ROOT / 'test').rglob('*.py')}


def test_a_source_distribution_holds_every_file_of_the_checkout(source: Path) -> None:
    missing = {str(path) for path in kept_files() if not (source / path).exists()}
    assert missing == set()


def test_links_of_the_description_lead_to_files_that_exist_and_work_elsewhere(metadata: Message) -> None:
    links = LINK.findall(str(metadata.get_payload()))
    home = metadata['Home-page'] or next(
        each.split(', ')[1] for each in metadata.get_all('Project-URL', []) if each.startswith('Source')
    )
    assert len(links) > 30
    for link in links:
        assert re.match(r'https?://|#', link), link
        if link.startswith(home):
            path = re.sub(r'^/(blob|raw)/v[\d.]+/', '', link.removeprefix(home)).split('#')[0]
            assert (ROOT / path).exists(), link


def test_programs_claim_no_name_that_others_use(source: Path) -> None:
    (entries,) = source.parent.glob('*.egg-info/entry_points.txt')
    names = re.findall(r'^(\w+) = ', entries.read_text(), re.MULTILINE)
    assert len(names) == 22
    assert [name for name in names if not name.startswith('tactile')] == []


def test_pip_installs_the_package_alone_and_the_source_holds_its_benchmarks(source: Path) -> None:
    (installed,) = source.parent.glob('*.egg-info/top_level.txt')
    assert installed.read_text() == 'tactile_nodes\n'
    assert (source / 'benchmarks' / '__init__.py').is_file()


def test_the_index_gets_who_where_and_what(metadata: Message) -> None:
    assert metadata['Author'] == 'tactile_nodes maintainers'
    assert {each.split(',')[0] for each in metadata.get_all('Project-URL', [])} >= {
        'Documentation',
        'Changes',
        'Issues',
    }
    assert 'Operating System :: POSIX :: Linux' in metadata.get_all('Classifier', [])
    assert 'ROS 2' in metadata['Keywords']


def test_each_python_that_the_package_names_can_install_the_pinned_versions(metadata: Message) -> None:
    named = [each.removeprefix('Programming Language :: Python :: ') for each in metadata.get_all('Classifier', [])]
    pythons = [each for each in named if re.fullmatch(r'3\.\d+', each)]
    assert len(pythons) >= 4
    pins = re.findall('^.+==.+$', (ROOT / 'constraints.txt').read_text(encoding='ascii'), re.MULTILINE)
    installed = {each.name: each for each in importlib.metadata.distributions()}
    checked = 0
    for pin in map(Requirement, pins):
        if (found := installed.get(pin.name)) is None or found.version not in pin.specifier:
            continue
        for python in pythons:
            if pin.marker is None or pin.marker.evaluate({'python_version': python}):
                assert f'{python}.0' in SpecifierSet(found.metadata.get('Requires-Python') or ''), (pin, python)
                checked += 1
    assert checked > 100


def test_on_arm_nothing_is_required_that_has_no_wheels_there(metadata: Message) -> None:
    """`dds` alone asks for Cyclone DDS, which pip can compile there; embreex it cannot."""
    wanted = [Requirement(each) for each in metadata.get_all('Requires-Dist', [])]
    for extra in ('', 'train', 'onnx', 'export', 'bridge', 'cluster', 'mesh', 'docs', 'dev'):
        here = {'extra': extra, 'platform_machine': 'aarch64'}
        names = {each.name for each in wanted if each.marker is None or each.marker.evaluate(here)}
        assert not names & {'embreex', 'cyclonedds'}, extra
        assert ('rtree' in names) == (extra in {'mesh', 'dev'})
