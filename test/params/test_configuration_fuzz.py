"""Configuration files that somebody has spoilt: each is read, or refused in one sentence; never another error.

Real files of ours are altered: characters changed, put in, or cut away, values exchanged for odd ones, lines moved.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_nodes import params
from tactile_nodes.bus.node.node import Node
from tactile_nodes.collection.plan.plan import load_plan_settings, make_plan
from tactile_nodes.contact_tables.gel_tables import load_gel
from tactile_nodes.errors import ConfigurationError, TactileError
from tactile_nodes.launching.reading import read_file
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.transfer.layer import load_layer_config
from tactile_nodes.nodes.composed import MODULES, node_class
from tactile_nodes.paths import share_directory

RELAXED = settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
ODD = (
    '', '~', '-1', '0', '1e400', '.nan', '.inf', '-.inf', '99999999999999999999', '0x10', "'5'", '[]', '[1, a]', '{}',
    '{a: 1}', 'true', '*x', '&a 1', '!!python/object:os.system x', '"\\uD800"', '\x00', '\ufeff', '- 1', '?', '[[1]]',
    '1:20', '2001-01-01', '=', '<<', '[' * 60, '1_000', '\N{SNOWMAN}', '../..', '/dev/zero', 'a' * 5000,
)  # fmt: skip


def _load_nodes(file: Path) -> None:
    """As all nodes that there are read the file."""
    blocks = params.load_parameter_file(file)
    for name in MODULES:
        kind: type[Node] = node_class(name)
        known = {entry.name for entry in params.describe(kind.PARAMS)}
        values = params.resolve_parameters(f'/{kind.NAME}', blocks)
        exact = params.exact_names(f'/{kind.NAME}', blocks)
        mine = {key: value for key, value in values.items() if key in known or key in exact}
        with contextlib.suppress(TactileError):  # another node may have no complaint
            params.from_mapping(kind.PARAMS, mine, source=kind.NAME)


def _load_plan(file: Path) -> None:
    make_plan(load_plan_settings(file))


READERS: dict[str, Callable[[Path], Any]] = {
    'live.yaml': _load_nodes,
    'collect.yaml': _load_nodes,
    'rigs/emulated.yaml': _load_nodes,
    'rigs/example.yaml': _load_nodes,
    'plans/random.yaml': _load_plan,
    'plans/quick.yaml': _load_plan,
    'gels/lifelike.yaml': lambda file: load_gel(str(file)),
    'train/quick.yaml': load_train_config,
    'train/portable.yaml': load_train_config,
    'transfer/paper.yaml': load_layer_config,
    '../launch/live.launch.yaml': read_file,
    '../launch/collect.launch.yaml': read_file,
}


def spoilt(draw: st.DrawFn, text: str) -> bytes:
    """A text with one to three alterations, as bytes that may not even be text.

    With `draw` of `st.data()`, so that a report names the alterations and not all of the file.
    """
    for _ in range(draw(st.integers(1, 3))):
        text = ALTERATIONS[draw(st.sampled_from(sorted(ALTERATIONS)))](draw, text)
    data = text.encode('utf-8', errors='surrogatepass')
    return data + draw(st.sampled_from([b'', b'', b'', b'\xff', b'\xfe\xff', b'\x00']))


def _cut(draw: st.DrawFn, text: str) -> str:
    start = draw(st.integers(0, len(text)))
    return text[:start] + text[start + draw(st.integers(1, 200)) :]


def _put(draw: st.DrawFn, text: str) -> str:
    at = draw(st.integers(0, len(text)))
    return (
        text[:at]
        + draw(st.one_of(st.text(max_size=4), st.sampled_from(['\t', '\n', ': ', '- ', '{', '*a'])))
        + text[at:]
    )


def _swap_value(draw: st.DrawFn, text: str) -> str:
    lines = text.splitlines(keepends=True)
    chosen = [number for number, line in enumerate(lines) if ':' in line]
    if not chosen:
        return text
    number = draw(st.sampled_from(chosen))
    head = lines[number].partition(':')[0]
    lines[number] = f'{head}: {draw(st.sampled_from(ODD))}\n'
    return ''.join(lines)


def _move_line(draw: st.DrawFn, text: str) -> str:
    lines = text.splitlines(keepends=True) or ['']
    line = lines.pop(draw(st.integers(0, len(lines) - 1)))
    lines.insert(draw(st.integers(0, len(lines))), ' ' * draw(st.integers(0, 4)) + line)
    return ''.join(lines)


ALTERATIONS = {'cut': _cut, 'put': _put, 'swap value': _swap_value, 'move line': _move_line}


@pytest.fixture(scope='module', params=READERS, ids=str)
def kind(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@RELAXED
@given(data=st.data())
def test_a_spoilt_file_is_read_or_refused_in_a_sentence(
    kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    read, text = READERS[kind], (share_directory() / 'config' / kind).read_text(encoding='utf-8')
    file = tmp_path_factory.getbasetemp() / f'spoilt_{Path(kind).name}'
    file.write_bytes(spoilt(data.draw, text))
    try:
        read(file)
    except TactileError as error:
        assert str(error)
        assert '\n' not in str(error)
        assert 'Traceback' not in str(error)


@pytest.mark.parametrize('content', [b'', bytes(100), b'[' * 600, b'{a: ' * 600, b'a: &a [*a]', b'\xff\xfe', b'- 1'])
@pytest.mark.parametrize('read', [*dict.fromkeys(READERS.values())])
def test_a_file_of_something_else_is_refused_in_a_sentence(
    read: Callable[[Path], Any], content: bytes, tmp_path: Path
) -> None:
    (tmp_path / 'any.yaml').write_bytes(content)
    try:
        read(tmp_path / 'any.yaml')
    except TactileError as error:
        assert '\n' not in str(error)


@pytest.mark.parametrize('name', READERS, ids=str)
def test_the_files_as_they_ship_are_read(name: str) -> None:
    READERS[name](share_directory() / 'config' / name)


@pytest.mark.parametrize('text', ['columns: 100000', 'kind: random\ncount: 99999999999', 'rows: 7000'])
def test_a_plan_for_years_is_refused_at_once(text: str, tmp_path: Path) -> None:
    (tmp_path / 'plan.yaml').write_text(text)
    with pytest.raises(ConfigurationError, match='presses, more than the limit of 200000'):
        load_plan_settings(tmp_path / 'plan.yaml')
