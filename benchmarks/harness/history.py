"""The state of the source according to git: its commit, and the changes since another commit."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Sequence
from pathlib import Path


def git(root: Path, *words: str) -> str | None:
    """The output of a git command; None without git, without a repository, or if the command fails."""
    try:
        done = subprocess.run(['git', '-C', str(root), *words], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def describe(root: Path) -> str | None:
    """'79b3fa3e3c5d', or '79b3fa3e3c5d-dirty' with uncommitted changes; changes of results do not count."""
    commit = git(root, 'describe', '--always', '--abbrev=12', '--exclude', '*')
    changed = git(root, 'status', '--porcelain', '--untracked-files=no', '--', ':/', ':!docs/results')
    return f'{commit}-dirty' if commit and changed else commit


def state(root: Path) -> str | None:
    """The commit and a hash of all changes since, as one text."""
    changes, commit = git(root, 'diff', 'HEAD'), describe(root)
    return None if changes is None else f'{commit} {hashlib.sha256(changes.encode()).hexdigest()}'


def limits(root: Path) -> str:
    """A sentence about missing history; '' if it is complete."""
    if git(root, 'rev-parse', 'HEAD') is None:
        return f'no history: {root} is no git repository, or git is not installed, so nothing is said of changes'
    if git(root, 'rev-parse', '--is-shallow-repository') == 'true':
        return 'this clone is shallow, so older commits are unknown; get them with: git fetch --unshallow'
    return ''


def commits_since(root: Path, commit: str, sources: Sequence[str]) -> int | None:
    """The number of commits that changed these paths; None if the commit is not in the history."""
    if git(root, 'cat-file', '-e', f'{commit}^{{commit}}') is None:
        return None
    count = git(root, 'rev-list', '--count', f'{commit}..HEAD', '--', *(f':(glob){source}' for source in sources))
    return None if count is None else int(count)
