"""The rules of the house that a linter does not know."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from tactile_nodes.bus.topics import TOPICS
from tactile_nodes.paths import share_directory

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'tactile_nodes'
BENCHMARKS = ROOT / 'benchmarks'
SOURCES = sorted(file for folder in (PACKAGE, BENCHMARKS, ROOT / 'reference') for file in folder.rglob('*.py'))
TESTS = sorted((ROOT / 'test').rglob('*.py'))
NODES = sorted(file for file in (PACKAGE / 'nodes').rglob('*.py') if file.stem not in {'__init__', 'composed'})
MOST_FILES = 20

LIVE_PATH = ['nodes.camera', 'nodes.flow_features', 'nodes.force_estimator', 'nodes.composed', 'cli.main', 'cli.view']


def _name(file: Path) -> str:
    return str(file.relative_to(ROOT))


def test_live_sensing_imports_nothing_it_does_not_need() -> None:
    imports = '; '.join(f'import tactile_nodes.{module}' for module in LIVE_PATH)
    code = f'import sys; {imports}; print(*sys.modules)'
    ended = subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert not {'torch', 'rclpy', 'matplotlib', 'scipy', 'tactile_nodes.learning'} & set(ended.stdout.split())


def test_files_have_one_subject_and_a_docstring() -> None:
    assert not [_name(file) for file in SOURCES if not re.match(r'(#.*\n|\n)*r?"""', _text(file))]
    assert not [_name(file) for file in SOURCES if len(_text(file).splitlines()) > 400]


def test_no_folder_has_more_files_than_a_stranger_reads_through() -> None:
    files = Counter(_name(file.parent) for file in [*SOURCES, *TESTS] if file.stem != '__init__')
    assert {folder: count for folder, count in files.items() if count > MOST_FILES} == {}


def test_no_topic_is_spelt_outside_the_table() -> None:
    # Words of everyday use, and names that nodes and devices share with what they publish, are no sign of a topic.
    shared = {'flow_features', 'force_torque', 'hand_wrench'}
    distinctive = {name for name in TOPICS if '_' in name or '/' in name} - shared
    quoted = re.compile('|'.join(f'[\'"]{name}[\'"]' for name in map(re.escape, distinctive)))
    maybe = (file for file in SOURCES if file != PACKAGE / 'bus' / 'topics.py' and quoted.search(_text(file)))
    assert not {_name(file): found for file in maybe if (found := _strings(file) & distinctive)}


def _strings(file: Path) -> set[str]:
    found = (node for node in ast.walk(ast.parse(_text(file))) if isinstance(node, ast.Constant))
    return {node.value for node in found if isinstance(node.value, str)}


@cache
def _text(file: Path) -> str:
    return file.read_text(encoding='utf-8')


@pytest.mark.parametrize('file', NODES, ids=_name)
def test_nodes_hold_no_arithmetic_on_arrays(file: Path) -> None:
    text = file.read_text(encoding='utf-8')
    called = set(re.findall(r'\bnp\.(\w+)\(', text))
    assert called <= {'array', 'asarray', 'zeros'}


def test_every_node_has_its_program() -> None:
    programs = re.search(r'NODES = \[(.*?)\]', (ROOT / 'setup.py').read_text(encoding='utf-8'), re.DOTALL)
    cmake = re.findall(r'foreach\(node (.*?)\)', (ROOT / 'CMakeLists.txt').read_text(encoding='utf-8'))
    assert programs is not None
    expected = {file.stem for file in NODES} | {'composed'}
    assert set(re.findall(r"'(\w+)'", programs.group(1))) == expected
    assert {name for names in cmake for name in names.split()} == expected


def test_share_folder_of_a_source_tree_is_its_root() -> None:
    assert share_directory() == ROOT


def test_versions_agree() -> None:
    version = re.search(r"__version__ = '(.*)'", (PACKAGE / '__init__.py').read_text(encoding='utf-8'))
    assert version is not None
    assert f"VERSION = '{version.group(1)}'" in (ROOT / 'setup.py').read_text(encoding='utf-8')
    assert f'<version>{version.group(1)}</version>' in (ROOT / 'package.xml').read_text(encoding='utf-8')
    assert f'\nversion: {version.group(1)}\n' in (ROOT / 'CITATION.cff').read_text(encoding='utf-8')
    assert f'\n## [{version.group(1)}]' in (ROOT / 'CHANGELOG.md').read_text(encoding='utf-8')
