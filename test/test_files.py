"""Files from elsewhere: what they are and how large is known before a byte of them is read."""

from __future__ import annotations

import io
import os
import re
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from tactile_nodes.collection.plan.plan import read_points
from tactile_nodes.contact_tables.touch_bodies import body_of
from tactile_nodes.drivers.camera.file import read_image
from tactile_nodes.drivers.camera.pictures import read_grey
from tactile_nodes.errors import TactileError
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.learning.run.folder import read_run
from tactile_nodes.learning.tables.presses import read_table
from tactile_nodes.model_file import load_model
from tactile_nodes.params import load_listed, load_parameter_file
from tactile_nodes.sensors.camera_file import read_camera_file
from tactile_nodes.sensors.covering import mask_of

READERS: dict[str, Callable[[Path], object]] = {
    'a.npz': load_dataset,
    'a.safetensors': load_model,
    'a.yaml': load_parameter_file,
    'hand.yaml': lambda file: load_listed(file, 'sensors'),
    'camera.yaml': read_camera_file,
    'a.csv': read_points,
    'a.png': read_grey,
    'b.png': read_image,
    'mask.png': lambda file: mask_of(file, 640, 480),
    'b.csv': read_table,
    'a.parquet': read_table,
    'a.npy': lambda file: body_of(str(file)),
    'a.stl': lambda file: body_of(str(file)),
    'run.yaml': lambda file: read_run(file.parent),
}

File = TypeVar('File', Path, io.FileIO)


def refusal(read: Callable[[Path], object], file: Path) -> str:
    """What a reader says, that must not have taken memory for it."""
    tracemalloc.start()
    try:
        with pytest.raises(TactileError) as caught:
            read(file)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 16 << 20
    return str(caught.value)


@pytest.mark.parametrize('name', READERS)
def test_a_named_pipe_is_refused_and_not_waited_for(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    assert 'it is not a regular file' in refusal(READERS[name], tmp_path / name)


@pytest.mark.parametrize('name', sorted(READERS.keys() - {'a.npz'}))
def test_twenty_gigabytes_of_nothing_are_not_read(name: str, tmp_path: Path) -> None:
    with (tmp_path / name).open('wb') as file:
        file.truncate(20 << 30)
    assert 'it has 21474836480 bytes' in refusal(READERS[name], tmp_path / name)


@pytest.mark.parametrize('name', READERS)
def test_a_name_that_no_file_can_have_is_refused(name: str, tmp_path: Path) -> None:
    assert 'it is not a valid file name' in refusal(READERS[name], tmp_path / 'a\0' / name)


@pytest.mark.parametrize('name', ['a.png', 'b.png', 'mask.png'])
def test_a_small_file_of_a_gigantic_picture_is_not_unpacked(name: str, tmp_path: Path) -> None:
    header = b'IHDR' + struct.pack('>IIBBBBB', 32000, 32000, 8, 0, 0, 0, 0)
    chunks = struct.pack('>I', 13) + header + struct.pack('>I', zlib.crc32(header)) + bytes(4) + b'IEND\xaeB`\x82'
    (tmp_path / name).write_bytes(b'\x89PNG\r\n\x1a\n' + chunks)
    said = refusal(READERS[name], tmp_path / name)
    assert 'it has 32000x32000 pixels, more than the limit of 8192x8192 pixels (64 megapixels)' in said


def zipped(file: File, names: tuple[str, ...], packing: int = zipfile.ZIP_DEFLATED) -> File:
    """Entries of 64 MB of zeros, packed to 64 kB each unless stated otherwise."""
    with zipfile.ZipFile(file, 'w', packing) as archive:
        for name in names:
            with archive.open(f'{name}.npy', 'w') as entry:
                np.lib.format.write_array(entry, np.zeros(16 << 20, np.float32))
    return file


@pytest.fixture(scope='module')
def packed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Of 192 MB in the entries that a data set has."""
    file = tmp_path_factory.mktemp('packed') / 'a.npz'
    return zipped(file, ('card', 'fingerprint', 'features')).read_bytes()


def test_a_data_set_with_names_of_others_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    said = refusal(load_dataset, zipped(tmp_path / 'a.npz', ('bomb',)))
    assert "it holds 'bomb.npy'" in said


def test_a_data_set_that_would_unpack_to_a_thousand_times_its_size_is_refused_before(
    packed: bytes, tmp_path: Path
) -> None:
    (tmp_path / 'a.npz').write_bytes(packed)
    assert 'would unpack from' in refusal(load_dataset, tmp_path / 'a.npz')


def test_holes_of_a_sparse_file_count_for_nothing_beside_what_it_would_unpack_to(packed: bytes, tmp_path: Path) -> None:
    """A gigabyte of nothing before entries of 192 MB that are packed to 192 kB."""
    with (tmp_path / 'a.npz').open('wb') as file:
        file.write(b'PK\3\4')
        file.seek(1 << 30)
        file.write(packed)
    sizes = re.search(r'would unpack from (\d+) to (\d+) bytes', refusal(load_dataset, tmp_path / 'a.npz'))
    assert sizes is not None
    assert int(sizes[1]) < len(packed)
    assert int(sizes[2]) == 3 * ((64 << 20) + 128)  # of numpy's header


class Sparse(io.FileIO):
    """A file in which zeros that are written become holes."""

    def write(self, data: bytes | memoryview) -> int:
        if np.frombuffer(data, np.uint8).any():
            return super().write(data)
        self.seek(len(data), os.SEEK_CUR)
        return len(data)


def test_entries_that_are_holes_themselves_are_not_read(tmp_path: Path) -> None:
    with Sparse(tmp_path / 'a.npz', 'w') as file:
        zipped(file, ('card', 'fingerprint', 'features'), zipfile.ZIP_STORED)
    assert (tmp_path / 'a.npz').stat().st_size > 3 * (64 << 20)
    assert 'would unpack from' in refusal(load_dataset, tmp_path / 'a.npz')


def test_a_single_array_of_gigabytes_is_no_data_set(tmp_path: Path) -> None:
    with (tmp_path / 'a.npz').open('wb') as file:
        np.lib.format.write_array_header_1_0(file, {'descr': '<f4', 'fortran_order': False, 'shape': (5 << 30,)})
        file.truncate(20 << 30)
    assert 'is not a data set of tactile_nodes' in refusal(load_dataset, tmp_path / 'a.npz')


def test_a_data_set_whose_list_of_entries_takes_gigabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """Of ZIP64 (APPNOTE.TXT 4.3.14 to 4.3.16), nearly all of it a hole."""
    size = 3 << 30
    with (tmp_path / 'a.npz').open('wb') as file:
        file.write(b'PK\3\4')
        file.seek(size)
        file.write(struct.pack('<4sQHHLLQQQQ', b'PK\6\6', 44, 45, 45, 0, 0, 1, 1, size - 4, 4))
        file.write(struct.pack('<4sLQL', b'PK\6\7', 0, size, 1))
        file.write(struct.pack('<4sHHHHLLH', b'PK\5\6', 0, 0, 0xFFFF, 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0))
    tracemalloc.start()
    try:
        assert 'is damaged or not a data set' in refusal(load_dataset, tmp_path / 'a.npz')
        assert tracemalloc.get_traced_memory()[1] < 32 << 20
    finally:
        tracemalloc.stop()
