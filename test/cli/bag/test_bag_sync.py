"""`tactile bag sync`: what it prints of clocks that can be fitted, that cannot, and of a rig that is alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.bus.topics import SYNC_EDGE
from tactile_nodes.cli.main import main
from tactile_nodes.conversions import header
from tactile_nodes.learning.recorded.clocks import bag_clocks
from tactile_nodes.learning.recorded.clocks_picture import residuals
from tactile_nodes.messages import types

START_NS = 1_700_000_000_000_000_000
TIMES_NS = np.round(np.cumsum(np.random.default_rng(3).uniform(0.4, 2.5, 40)) * 1e9).astype(np.int64)
BEHIND_NS = np.round((TIMES_NS - 300_000_000) / 1.0001).astype(np.int64)
"""The same edges by a clock that is 0.3 s behind and loses 100 ppm."""


def bag(folder: Path, **seen: np.ndarray) -> Path:
    writer = BagWriter(folder)
    writer.add_topic(BagTopic.of_type('/' + SYNC_EDGE.name, SYNC_EDGE.type_name))
    for recorder, times_ns in seen.items():
        for number, time_ns in enumerate(times_ns):
            stamp_ns = START_NS + int(time_ns)
            edge = types.SyncEdge(
                header=header(stamp_ns, recorder), level=number % 2 == 0, count=number + 1, uncertainty=0.0005
            )
            writer.write('/' + SYNC_EDGE.name, messages.encode(edge), stamp_ns, stamp_ns)
    writer.close()
    return folder


def test_offset_drift_and_residuals_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['bag', 'sync', str(bag(tmp_path / 'two', rig=TIMES_NS, camera=BEHIND_NS))]) == 0
    head, columns, row = capsys.readouterr().out.splitlines()
    assert head.startswith('fitted to rig, 40 edges')
    assert columns.split()[0] == row.split()[0].replace('camera', 'recorder')
    name, edges, matched, offset, drift, *_ = row.split()
    assert (name, edges, matched) == ('camera', '40', '40')
    # Halfway through some 60 s, 100 ppm have added 3 ms.
    assert float(offset) == pytest.approx(0.3 + 1e-4 * float(BEHIND_NS.mean()) / 1e9, abs=1e-4)
    assert float(drift) == pytest.approx(100, abs=0.01)


def test_a_clock_that_cannot_be_fitted_is_reported_with_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = bag(tmp_path / 'few', rig=TIMES_NS, camera=BEHIND_NS, light=BEHIND_NS[:5])
    assert main(['bag', 'sync', str(folder)]) == 1
    assert 'light: 5 edges, too few edges: too few edges seen by both to synchronise: 5' in capsys.readouterr().out


def test_a_rig_that_nobody_watches_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['bag', 'sync', str(bag(tmp_path / 'alone', rig=TIMES_NS))]) == 1
    assert capsys.readouterr().out == 'only rig saw the 40 edges of the line: there is nothing to compare\n'


def test_another_recorder_can_be_the_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = bag(tmp_path / 'two', rig=TIMES_NS, camera=BEHIND_NS)
    assert main(['bag', 'sync', str(folder), '--reference', 'camera']) == 0
    assert capsys.readouterr().out.splitlines()[2].startswith('rig ')
    assert main(['bag', 'sync', str(folder), '--reference', 'moon']) == 1
    assert 'recorders in it are: camera, rig' in capsys.readouterr().err


def test_the_picture_is_drawn_with_refusals_too(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    folder = bag(tmp_path / 'few', rig=TIMES_NS, camera=BEHIND_NS, light=BEHIND_NS[:5])
    main(['bag', 'sync', str(folder), '--picture', str(tmp_path / 'pictures' / 'sync.png')])
    assert (tmp_path / 'pictures' / 'sync.png').read_bytes().startswith(b'\x89PNG')


def test_residuals_of_clocks_that_differ_by_a_line_are_rounding_alone(tmp_path: Path) -> None:
    with BagReader(bag(tmp_path / 'two', rig=TIMES_NS, camera=BEHIND_NS)) as reader:
        clocks = bag_clocks(reader)
    at_s, left_ms = residuals(clocks.others[0], clocks)
    assert at_s[0] == 0.0 and at_s[-1] == pytest.approx((TIMES_NS[-1] - TIMES_NS[0]) / 1e9)
    assert np.abs(left_ms).max() < 1e-3
