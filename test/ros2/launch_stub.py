"""A prefix that holds, instead of the nodes of this package, programs that write down how they were started."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import yaml
from ros2_here import ROOT
from ros2_programs import Program

LAUNCHES = sorted((ROOT / 'launch').glob('*.launch.yaml'))
_QUIET_S = 4.0
_STUB = """\
#!{python}
import json, os, pathlib, signal, sys
signal.signal(signal.SIGINT, lambda *_: os._exit(0))
signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
signal.pthread_sigmask(signal.SIG_UNBLOCK, {{signal.SIGINT}})  # our launcher has it wait until a node can be asked
words = sys.argv[1:]
files = [words[place + 1] for place, word in enumerate(words) if word == '--params-file']
noted = dict(name=os.path.basename(sys.argv[0]), words=words, files=[open(file).read() for file in files])
draft = pathlib.Path(os.environ['LAUNCH_NOTES'], f'{{os.getpid()}}.draft')
draft.write_text(json.dumps(noted))
draft.rename(draft.with_suffix('.json'))
signal.pause()
"""


def make_prefix(folder: Path) -> Path:
    """An ament prefix with a stub for each program, and the files of this source tree."""
    programs, share = folder / 'lib/tactile_nodes', folder / 'share'
    marker = share / 'ament_index/resource_index/packages/tactile_nodes'
    for made in (programs, share / 'tactile_nodes', marker.parent):
        made.mkdir(parents=True)
    marker.touch()
    for name in ('launch', 'config', 'models', 'msg', 'package.xml'):
        (share / 'tactile_nodes' / name).symlink_to(ROOT / name)
    for node in (ROOT / 'tactile_nodes/nodes').rglob('[a-z]*.py'):
        program = programs / f'{node.stem}_node'
        program.write_text(_STUB.format(python=sys.executable))
        program.chmod(0o755)
    return folder


def required_arguments(file: Path) -> list[str]:
    """A value for each argument of a launch file that has no default, as both launchers want it."""
    entries = [item['arg'] for item in yaml.safe_load(file.read_text(encoding='utf-8'))['launch'] if 'arg' in item]
    return [f'{entry["name"]}:=given' for entry in entries if 'default' not in entry]


def started_by(
    launcher: list[str], prefix: Path, notes: Path, environment: dict[str, str], count: int | None = None
) -> list[dict[str, Any]]:
    """How `launcher` starts programs, sorted; it is ended when `count` have come, or no new one for a while."""
    notes.mkdir()
    before = environment.get('AMENT_PREFIX_PATH', '')
    env = {**environment, 'AMENT_PREFIX_PATH': f'{prefix}:{before}'.rstrip(':'), 'LAUNCH_NOTES': str(notes)}
    said = notes / 'said.txt'
    program = Program(launcher, said, env=env)
    try:
        _wait_until_quiet(notes, program.process, count)
    finally:
        program.end(signal.SIGINT, 20.0)
    found = [json.loads(file.read_text()) for file in notes.glob('*.json')]
    assert found, said.read_text()
    return sorted((plain(entry, prefix) for entry in found), key=json.dumps)


def _wait_until_quiet(notes: Path, program: subprocess.Popen[str], all_there: int | None) -> None:
    count, since_s, begin_s = 0, time.monotonic(), time.monotonic()
    while program.poll() is None and time.monotonic() - begin_s < 60.0:
        found = len(list(notes.glob('*.json')))
        if all_there is not None and found >= all_there:
            return
        if found > count:
            count, since_s = found, time.monotonic()
        if count and time.monotonic() - since_s > _QUIET_S:
            return
        time.sleep(0.05)


def plain(entry: dict[str, Any], prefix: Path) -> dict[str, Any]:
    """Without what two launchers may name differently: temporary files, and the prefix, in parameter files too."""
    share = f'{prefix}/share/tactile_nodes'
    words = [re.sub(r'^\S*/launch_params_\w+(\.yaml)?$', '<temporary>', word) for word in entry['words']]
    words = [word.replace(share, str(ROOT)) for word in words]
    files = [yaml.safe_load(text.replace(share, str(ROOT))) for text in entry['files']]
    return {'name': entry['name'], 'words': words, 'files': files}
