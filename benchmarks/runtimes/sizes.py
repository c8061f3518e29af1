"""The disk space of a runtime: its package, and its dependencies beyond those of tactile_nodes."""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Iterable


def installed_size(name: str) -> dict[str, float | str] | None:
    """Version and size (MB) of a package, alone and with its dependencies; None if it is not installed."""
    try:
        version = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
    brought = _needed([name]) - _needed(['tactile_nodes']) - {name}
    alone = _size_mb([name])
    return {'version': version, 'alone_mb': alone, 'with_what_it_brings_mb': alone + _size_mb(brought)}


def _needed(names: Iterable[str]) -> set[str]:
    """Installed packages and all their requirements, without extras."""
    found: set[str] = set()
    left = {_plain(name) for name in names}
    while left:
        name = left.pop()
        try:
            required = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:  # only needed on another system or Python version
            continue
        found.add(name)
        left |= {_plain(each) for each in required if 'extra ==' not in each} - found
    return found


def _plain(requirement: str) -> str:
    """The package name in a requirement, normalized as on PyPI."""
    return re.sub(r'[-_.]+', '-', re.split(r'[^\w.-]', requirement, maxsplit=1)[0]).lower()


def _size_mb(names: Iterable[str]) -> float:
    files = (file.locate() for name in names for file in importlib.metadata.files(name) or [])
    return sum(each.stat().st_size for each in files if each.is_file()) / 1e6  # type: ignore[attr-defined]
