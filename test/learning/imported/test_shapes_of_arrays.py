"""`import_arrays` names the array that does not fit the images, and the shape that it must have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.imported.arrays import import_arrays, options_of

GOOD = {'x_mm': np.zeros(4), 'y_mm': np.zeros(4), 'force_n': np.zeros(4)}


@pytest.mark.parametrize(
    ('wrong', 'said'),
    [
        (
            {'shear_n': np.zeros((4, 3))},
            r'shear_n has the shape \(4, 3\), but must have \(4, 2\): a row for each image',
        ),
        ({'shear_n': np.zeros(4)}, r'shear_n has the shape \(4,\), but must have \(4, 2\)'),
        ({'torque_nm': np.zeros((4, 2))}, r'torque_nm has the shape \(4, 2\), but must have \(4, 3\)'),
        ({'depth_mm': np.zeros((4, 2))}, r'depth_mm has the shape \(4, 2\), but must have \(4,\)'),
        ({'x_mm': np.zeros(3)}, r'x_mm has the shape \(3,\), but must have \(4,\)'),
        ({'y_mm': np.zeros((4, 1))}, r'y_mm has the shape \(4, 1\), but must have \(4,\)'),
        ({'force_n': 1.0}, r'force_n has the shape \(\), but must have \(4,\)'),
        ({'force_n': ['light'] * 4}, r'force_n must hold numbers, in the shape \(4,\)'),
        ({'shear_n': [[1], [1, 2], [1], [1]]}, r'shear_n must hold numbers, in the shape \(4, 2\)'),
        ({'indenter': ['ball:5']}, 'indenter has 1 rows, but there are 4 images'),
        ({'order': 'gbr'}, "order is 'gbr', but must be one of 'rgb', 'bgr'"),
    ],
)
def test_what_does_not_fit_four_images_is_named(wrong: dict[str, Any], said: str) -> None:
    images = np.zeros((4, 48, 64, 3), np.uint8)
    with pytest.raises(DatasetError, match=f'^theirs: {said}'):
        import_arrays(images, **{**GOOD, **wrong}, options=options_of('fast'), name='theirs')


class Labelled(list[str]):
    """Rows by a label, as of a filtered table."""

    def __getitem__(self, label: Any) -> Any:
        raise KeyError(label)


@pytest.mark.parametrize(
    ('indenter', 'expected'),
    [
        (b'ring', ['ring'] * 4),  # as an HDF5 attribute may be: its letters are no list of four indenters
        (None, [''] * 4),
        (['ring', None, b'edge', ''], ['ring', '', 'edge', '']),
        (Labelled(['ring'] * 4), ['ring'] * 4),
    ],
)
def test_indenters_of_all_presses_or_of_each_may_be_unknown(
    indenter: Any, expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = []
    monkeypatch.setattr(
        'tactile_nodes.learning.imported.arrays.import_presses',
        lambda sources, *_, **__: tables.append(sources[0].table),
    )
    import_arrays(np.zeros((4, 48, 64), np.uint8), **GOOD, options=options_of('fast'), indenter=indenter)
    assert [row.indenter for row in tables[0].rows] == expected
