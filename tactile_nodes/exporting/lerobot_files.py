"""The files of a LeRobot data set of version 3.0: data/, meta/info.json, stats.json, tasks.parquet and episodes/."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.exporting.features import Feature
from tactile_nodes.exporting.libraries import require
from tactile_nodes.exporting.output import write_json
from tactile_nodes.exporting.parquet import METADATA_KEY, arrow_array
from tactile_nodes.exporting.resampling import Statistics

VERSION = 'v3.0'
FILES_A_CHUNK = 1000
_GROUP_ROWS = 512
_GROUP_ROWS_WITH_PICTURES = 16
_PLACE = 'chunk-{chunk_index:03d}/file-{file_index:03d}.parquet'
DATA_PATH = f'data/{_PLACE}'
EPISODES_PATH = f'meta/episodes/{_PLACE}'
INDEXES = {
    'timestamp': 'float32', 'stamp_ns': 'int64', 'frame_index': 'int64', 'episode_index': 'int64', 'index': 'int64',
    'task_index': 'int64',
}  # fmt: skip
"""Columns of every frame. `stamp_ns`, its time since 1970, is ours; every LeRobot data set has the others."""


class EpisodeFile:
    """The frames of one episode, in a file of its own."""

    def __init__(self, file: Path, features: list[Feature], fps: int, number: int, first_index: int) -> None:
        self._arrow, self._fps, self._features = require('pyarrow'), fps, features
        self.number, self.first_index, self.frames = number, first_index, 0
        file.parent.mkdir(parents=True, exist_ok=True)
        kinds = {feature.key: _kind(self._arrow, feature) for feature in features}
        kinds |= {name: getattr(self._arrow, dtype)() for name, dtype in INDEXES.items()}
        self._schema = self._arrow.schema(list(kinds.items()))
        pictures = any(feature.is_image for feature in features)
        self._group_rows = _GROUP_ROWS_WITH_PICTURES if pictures else _GROUP_ROWS
        # No picture comes twice, so a dictionary of them would only hold them in memory.
        self._writer = require('pyarrow.parquet').ParquetWriter(file, self._schema, use_dictionary=not pictures)
        self._waiting: list[dict[str, Any]] = []
        self.statistics = {feature.key: Statistics(_statistics_shape(feature)) for feature in features}
        self.statistics |= {name: Statistics((1,)) for name in INDEXES}

    def take(self, number: int, stamp_ns: int, values: dict[str, Any]) -> None:
        """Add one frame."""
        indexes = {
            'timestamp': np.float32(number / self._fps),
            'stamp_ns': stamp_ns,
            'frame_index': number,
            'episode_index': self.number,
            'index': self.first_index + number,
            'task_index': 0,
        }
        row = {**values, **indexes}
        for key, statistics in self.statistics.items():
            statistics.take(row[key] if not isinstance(row[key], bytes) else _brightness(row[key]))
        self._waiting.append(row)
        self.frames += 1
        if len(self._waiting) >= self._group_rows:
            self._flush()

    def close(self, facts: dict[str, Any]) -> None:
        """Write the waiting frames, and the facts into the footer."""
        self._flush()
        self._writer.add_key_value_metadata({METADATA_KEY: json.dumps(facts, ensure_ascii=False)})
        self._writer.close()

    def _flush(self) -> None:
        if self._waiting:
            arrays = [self._column(field) for field in self._schema]
            self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
            self._waiting = []

    def _column(self, field: Any) -> Any:
        values = [row[field.name] for row in self._waiting]
        if self._arrow.types.is_struct(field.type):
            return self._arrow.array([{'bytes': value, 'path': None} for value in values], field.type)
        return arrow_array(self._arrow, np.asarray(values), field.type)


class Meta:
    """The description of the whole data set. `features` are those of the first bag; all bags must have the same."""

    def __init__(self, folder: Path, fps: int, task: str, robot: str) -> None:
        self._arrow = require('pyarrow')
        self.folder, self.fps, self._task, self._robot = folder, fps, task, robot
        self.features: list[Feature] = []
        self._texts: dict[str, list[str]] = {}
        self.frames = 0
        self.episodes: list[dict[str, Any]] = []
        self._statistics: dict[str, Statistics] = {}

    def agree(self, features: list[Feature], texts: dict[str, list[str]], bag: Path) -> None:
        """Check the features of a bag, and the `texts` that say what they mean, against those of the bags before.

        Raises:
            DatasetError: they differ.
        """
        if not self.features:
            self.features, self._texts = features, texts
        elif self.features != features:
            first, now = ({feature.key for feature in each} for each in (self.features, features))
            raise DatasetError(
                f'{bag} has other features than the bags before it ({", ".join(sorted(first ^ now)) or "in shape"}); '
                'choose common topics with --topics, or export the bags separately'
            )
        for name, found in texts.items():
            if found != self._texts.get(name):
                raise DatasetError(
                    f'{name} is {found} in {bag} and {self._texts.get(name)} in the bags before it, so its numbers '
                    'would change their meaning; leave the topic out with --exclude, or export the bags separately'
                )

    def open_episode(self) -> EpisodeFile:
        """The file of the next episode."""
        number = len(self.episodes)
        return EpisodeFile(
            self.folder / DATA_PATH.format(**_place(number)), self.features, self.fps, number, self.frames
        )

    def close_episode(self, file: EpisodeFile, details: dict[str, Any], facts: dict[str, Any]) -> None:
        """Add a finished episode to the description."""
        file.close(facts)
        found = {key: statistics.summary() for key, statistics in file.statistics.items()}
        for key, statistics in file.statistics.items():
            self._statistics.setdefault(key, Statistics(statistics.shape)).join(statistics)
        place = _place(file.number)
        self.episodes.append({
            'episode_index': file.number,
            'tasks': [self._task],
            'length': file.frames,
            'data/chunk_index': place['chunk_index'],
            'data/file_index': place['file_index'],
            'dataset_from_index': self.frames,
            'dataset_to_index': self.frames + file.frames,
            'meta/episodes/chunk_index': 0,
            'meta/episodes/file_index': 0,
            **details,
            **{f'stats/{key}/{name}': value for key, each in found.items() if each for name, value in each.items()},
        })  # fmt: skip
        self.frames += file.frames

    def close(self, facts: dict[str, Any]) -> None:
        """Write everything below meta/."""
        write_json(self.folder / 'meta/info.json', self._info())
        write_json(self.folder / 'meta/stats.json', self._all_statistics())
        self._write_table(EPISODES_PATH.format(chunk_index=0, file_index=0), self._episode_table(), facts)
        self._write_table('meta/tasks.parquet', self._tasks(), facts)

    def _info(self) -> dict[str, Any]:
        indexes = {
            name: {'dtype': dtype, 'shape': [1], 'names': None, 'fps': self.fps} for name, dtype in INDEXES.items()
        }
        return {
            'codebase_version': VERSION,
            'robot_type': self._robot,
            'total_episodes': len(self.episodes),
            'total_frames': self.frames,
            'total_tasks': 1,
            'chunks_size': FILES_A_CHUNK,
            'data_files_size_in_mb': 100,
            'video_files_size_in_mb': 200,
            'fps': self.fps,
            'splits': {'train': f'0:{len(self.episodes)}'},
            'data_path': DATA_PATH,
            'video_path': None,
            'features': {**{each.key: each.described(self.fps) for each in self.features}, **indexes},
        }

    def _all_statistics(self) -> dict[str, Any]:
        """Statistics over all episodes."""
        found = {key: statistics.summary() for key, statistics in self._statistics.items()}
        return {key: each for key, each in found.items() if each}

    def _episode_table(self) -> Any:
        names = list(dict.fromkeys(name for episode in self.episodes for name in episode))
        return self._arrow.table({name: [episode.get(name) for episode in self.episodes] for name in names})

    def _tasks(self) -> Any:
        """A table as pandas writes it with the task as index, because it is read so."""
        index = '__index_level_0__'
        described = [
            {'name': 'task_index', 'field_name': 'task_index', 'pandas_type': 'int64', 'numpy_type': 'int64',
             'metadata': None},
            {'name': None, 'field_name': index, 'pandas_type': 'unicode', 'numpy_type': 'object', 'metadata': None},
        ]  # fmt: skip
        pandas = {'index_columns': [index], 'column_indexes': [], 'columns': described, 'pandas_version': '2.0.0'}
        table = self._arrow.table({'task_index': [0], index: [self._task]})
        return table.replace_schema_metadata({'pandas': json.dumps(pandas)})

    def _write_table(self, name: str, table: Any, facts: dict[str, Any]) -> None:
        file = self.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        about = {**(table.schema.metadata or {}), METADATA_KEY.encode(): json.dumps(facts, ensure_ascii=False).encode()}
        require('pyarrow.parquet').write_table(table.replace_schema_metadata(about), file)


def _kind(arrow: Any, feature: Feature) -> Any:
    if feature.is_image:
        return arrow.struct([('bytes', arrow.binary()), ('path', arrow.string())])
    scalar = arrow.bool_() if feature.dtype == 'bool' else getattr(arrow, feature.dtype)()
    return scalar if feature.shape == (1,) else arrow.list_(scalar, feature.shape[0])


def _statistics_shape(feature: Feature) -> tuple[int, ...]:
    return (3, 1, 1) if feature.is_image else feature.shape  # each pixel of a picture is a sample of three channels


def _place(number: int) -> dict[str, int]:
    return {'chunk_index': number // FILES_A_CHUNK, 'file_index': number % FILES_A_CHUNK}


def _brightness(encoded: bytes) -> np.ndarray:
    """Every fourth pixel along both axes of a picture, red first, 0 to 1: enough for mean and standard deviation."""
    picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[::4, ::4, ::-1] / 255.0)
