"""What every benchmark reports besides its numbers, and how numbers are summed up and shown."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.evaluation.tables import Table
from tactile_nodes.paths import share_directory

_PACKAGES = ('numpy', 'pyzmq', 'rosbags', 'opencv-contrib-python-headless')


def surroundings(command: str) -> dict[str, Any]:
    """Machine, load, versions and commit: without them a time means nothing."""
    return {
        'command': command,
        'machine': {
            'processor': _processor(),
            'cores': os.cpu_count(),
            'cores_allowed': len(os.sched_getaffinity(0)),
            'system': platform.platform(),
            'load_before': [round(load, 2) for load in os.getloadavg()],
        },
        'versions': {'python': platform.python_version(), **_versions()},
        'commit': _commit(),
    }


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """Median, p90 and p99."""
    return {f'p{level}': float(np.percentile(values, level)) for level in (50, 90, 99)}


def spread(values: Sequence[float]) -> dict[str, float]:
    """Median and range over the rounds of a run."""
    return {'median': float(np.median(values)), 'low': float(min(values)), 'high': float(max(values))}


def write_json(file: Path, result: dict[str, Any]) -> None:
    """Keep a result.

    Raises:
        ConfigurationError: the file cannot be written.
    """
    try:
        file.write_text(json.dumps(result, indent=1) + '\n', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(f'cannot write the result to {file}: {error.strerror}') from error


def keep(folder: Path, name: str, text: str, result: dict[str, Any]) -> None:
    """Write a benchmark's page and numbers, NAME.md and NAME.json, into a folder that is made if need be.

    Raises:
        ConfigurationError: it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f'{name}.md').write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(f'cannot write to {folder} ({error.strerror}); choose another with -o') from error
    write_json(folder / f'{name}.json', result)


def machine_and_commit(result: Mapping[str, Any]) -> str:
    """'AMD EPYC, 2 cores, load before 0.4; commit c0ffee' of what `surroundings` found."""
    machine = result['machine']
    return (
        f'{machine["processor"]}, {machine["cores_allowed"]} cores, load before {machine["load_before"][0]}; commit '
        f'{result["commit"]}'
    )


def named_versions(result: Mapping[str, Any]) -> str:
    """'python 3.11.7, numpy 2.4.6' of what `surroundings` found."""
    return ', '.join(f'{name} {version}' for name, version in result['versions'].items())


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose columns line up: the first to the left, the others to the right."""
    return Table('', tuple(heads), tuple(map(tuple, rows))).markdown()


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(':')[2].strip() for line in lines if line.startswith('model name')), platform.machine())


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # not all of them are needed everywhere
            continue
    return found


def _commit() -> str:
    command = ['git', '-C', str(share_directory()), 'describe', '--always', '--dirty', '--abbrev=12']
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # installed rather than checked out
        return importlib.metadata.version('tactile_nodes')
