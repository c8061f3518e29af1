"""The checks of `tactile doctor`: one small function per subject, which takes the paths and values it checks.

A *problem* prevents the live view of the simulated sensor. Anything that costs only speed, a device or comfort is a
*warning*.
"""

from __future__ import annotations

import contextlib
import grp
import importlib
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TextIO

from tactile_nodes import paths
from tactile_nodes.cli import view
from tactile_nodes.errors import ConfigurationError

Level = Literal['ok', 'warning', 'problem']
GB = 1e9
LEAST_CORES = 2
LEAST_MEMORY = 1 * GB
LEAST_DISK = 5 * GB
IMAGES_PER_S, IMAGE_BYTES = 60, 440 * 440
NARROWEST_TERMINAL = 80

# Module and distribution; OpenCV comes in several distributions.
PACKAGES = {
    'numpy': ('numpy',),
    'scipy': ('scipy',),
    'numba': ('numba',),
    'cv2': ('opencv-contrib-python-headless', 'opencv-contrib-python', 'opencv-python-headless', 'opencv-python'),
    'zmq': ('pyzmq',),
    'rosbags': ('rosbags',),
    'mcap': ('mcap',),
    'rich': ('rich',),
    'yaml': ('pyyaml',),
    'safetensors': ('safetensors',),
    'serial': ('pyserial',),
    'psutil': ('psutil',),
    'argcomplete': ('argcomplete',),
    'aiohttp': ('aiohttp',),
}


@dataclass(frozen=True)
class Finding:
    """The result of a check: its name, level, what was found, and the remedy (empty if none is needed)."""

    name: str
    level: Level
    found: str
    remedy: str = ''


def python() -> Finding:
    """The interpreter; one that is too old does not start this program."""
    return Finding('Python', 'ok', platform.python_version())


def cores(count: int | None = None) -> Finding:
    """Number of cores that this process may use."""
    count = count or len(os.sched_getaffinity(0))
    if count >= LEAST_CORES:
        return Finding('cores', 'ok', str(count))
    return Finding('cores', 'warning', str(count), 'use two: one captures and renders images, one computes forces')


def memory(meminfo: Path = Path('/proc/meminfo')) -> Finding:
    """Available memory (MemAvailable of proc(5))."""
    values = _meminfo(meminfo)
    if 'MemAvailable' not in values:
        return Finding('memory', 'ok', 'not readable')
    text = f'{values["MemAvailable"] / GB:.1f} GB available of {values.get("MemTotal", 0) / GB:.1f}'
    if values['MemAvailable'] >= LEAST_MEMORY:
        return Finding('memory', 'ok', text)
    return Finding('memory', 'warning', text, 'close other programs; the live view needs about 0.5 GB')


def governor(cpu: Path = Path('/sys/devices/system/cpu/cpu0/cpufreq')) -> Finding:
    try:
        chosen = (cpu / 'scaling_governor').read_text(encoding='ascii').strip()
        driver = (cpu / 'scaling_driver').read_text(encoding='ascii').strip()
    except OSError:
        return Finding('CPU governor', 'ok', 'not readable, as in most virtual machines')
    text = f'{chosen} ({driver})'
    if chosen != 'powersave' or driver in {'intel_pstate', 'amd-pstate-epp'}:  # their "powersave" follows the load
        return Finding('CPU governor', 'ok', text)
    return Finding('CPU governor', 'warning', text, 'for even latencies: sudo cpupower frequency-set -g performance')


def packages(known: Mapping[str, tuple[str, ...]] = PACKAGES) -> Finding:
    """The packages that the live path needs, with their versions."""
    missing = [names[0] for module, names in known.items() if not _importable(module)]
    if missing:
        return Finding('packages', 'problem', f'missing: {", ".join(missing)}', _pip('install', missing))
    broken = {module: why for module in known if (why := _import_error(module))}
    if broken:
        listed = ', '.join(f'{module} ({why})' for module, why in broken.items())
        again = _pip('install --force-reinstall', [known[module][0] for module in broken])
        return Finding('packages', 'problem', f'cannot be imported: {listed}', again)
    return Finding('packages', 'ok', ', '.join(f'{module} {_version(names)}' for module, names in known.items()))


def torch() -> Finding:
    if _importable('torch'):
        return Finding('torch', 'ok', _version(('torch',)))
    return Finding('torch', 'ok', 'not installed', "only training needs it: pip install 'tactile_nodes[train]'")


def share(locate: Callable[[], Path] = paths.share_directory) -> Finding:
    """The data files of the package, with at least one model."""
    try:
        folder = locate()
    except ConfigurationError as error:
        return Finding('data files', 'problem', str(error), 'pip install --force-reinstall tactile_nodes')
    models = sorted((folder / 'models').rglob('*.safetensors'))
    if not models:
        return Finding('data files', 'problem', f'{folder} holds no model', 'train one with: tactile train')
    return Finding('data files', 'ok', f'{folder}, models: {", ".join(model.stem for model in models)}')


def run_directory(locate: Callable[[], Path] = paths.run_directory) -> Finding:
    """The folder for the sockets of the bus."""
    try:
        folder = locate()
    except ConfigurationError as error:
        return Finding('run folder', 'problem', str(error), 'set TACTILE_RUN_DIR to a folder of your own, mode 700')
    if not paths.is_short_enough(folder):
        return Finding(
            'run folder', 'problem', f'{folder} is too long for sockets', 'set TACTILE_RUN_DIR to a shorter path'
        )
    return Finding('run folder', 'ok', str(folder))


def log_directory(locate: Callable[[], Path] = paths.log_directory) -> Finding:
    """The folder for the output of launched nodes, without which no launch starts."""
    try:
        folder = locate().expanduser()
        paths.check_output(folder / 'launch.log')
    except ConfigurationError as error:
        return Finding('log folder', 'problem', str(error), 'set ROS_LOG_DIR to a folder that you own')
    return Finding('log folder', 'ok', str(folder))


def domain(environment: Mapping[str, str] = os.environ) -> Finding:
    """The domain, which separates robots on one host."""
    text = environment.get('ROS_DOMAIN_ID', '').strip()
    if not text:
        return Finding('domain', 'ok', '0 (ROS_DOMAIN_ID is not set)')
    if text.isdecimal() and int(text) <= 232:
        return Finding('domain', 'ok', f'{int(text)} (ROS_DOMAIN_ID)')
    return Finding('domain', 'problem', f'ROS_DOMAIN_ID is {text!r}', 'set it to a number from 0 to 232, or unset it')


def ros(environment: Mapping[str, str] = os.environ, rclpy: bool | None = None) -> Finding:
    distribution = environment.get('ROS_DISTRO', '')
    found = _importable('rclpy') if rclpy is None else rclpy
    if distribution and found:
        return Finding('ROS 2', 'ok', f'{distribution}, with rclpy')
    if distribution:
        return Finding(
            'ROS 2',
            'warning',
            f'{distribution} is sourced, but this Python has no rclpy',
            "use ROS 2's own Python: python3 -m venv --system-site-packages",
        )
    return Finding('ROS 2', 'ok', 'not sourced', 'only the bridge needs it: source /opt/ros/<distribution>/setup.bash')


def cameras(dev: Path = Path('/dev'), sysfs: Path = Path('/sys/class/video4linux')) -> Finding:
    """Video devices, their names, and whether this user may open them."""
    nodes = sorted(dev.glob('video[0-9]*'), key=lambda node: int(node.name[5:]))
    if not nodes:
        return Finding('cameras', 'warning', 'none', 'connect one, or use the simulated camera')
    text = ', '.join(f'{node.name} {_card(sysfs / node.name)}'.strip() for node in nodes)
    if names := _links(dev / 'v4l' / 'by-id'):
        text += f'; by id: {", ".join(names)}'
    return _access('cameras', text, nodes, 'video')


def serial_ports(dev: Path = Path('/dev')) -> Finding:
    """Serial ports of CNC controllers and force sensors, and whether this user may open them."""
    ports = sorted([*dev.glob('ttyUSB*'), *dev.glob('ttyACM*')])
    if not ports:
        return Finding('serial ports', 'ok', 'none', 'only data collection needs them')
    text = ', '.join(port.name for port in ports)
    if names := _links(dev / 'serial' / 'by-id'):
        text += f'; by id: {", ".join(names)}'
    return _access('serial ports', text, ports, 'dialout')


def disk(folder: Path | None = None) -> Finding:
    """Disk space for recordings, in minutes of 440x440 images at 60 a second."""
    folder = folder or Path.cwd()
    if not os.access(folder, os.W_OK | os.X_OK):
        return Finding('disk', 'warning', f'{folder} is not writable', 'record elsewhere: tactile bag record -o FOLDER')
    free = shutil.disk_usage(folder).free
    minutes = free / (IMAGES_PER_S * IMAGE_BYTES) / 60
    text = f'{free / GB:.1f} GB free in {folder}: {minutes:.0f} minutes of images'
    if free >= LEAST_DISK:
        return Finding('disk', 'ok', text)
    return Finding('disk', 'warning', text, 'free some space, or record elsewhere: tactile bag record -o FOLDER')


def terminal(stream: TextIO = sys.stdout, environment: Mapping[str, str] = os.environ) -> Finding:
    """Whether the live view can be drawn in this terminal."""
    encoding = (stream.encoding or 'ascii').lower().replace('-', '')
    if encoding != 'utf8':
        return Finding('terminal', 'warning', f'encoding {stream.encoding}', 'export LANG=C.UTF-8 to see the force map')
    if not stream.isatty():
        return Finding('terminal', 'ok', 'output goes to a file or pipe')
    if not view.can_draw(stream, environment):
        found = 'TERM is dumb, unknown or not set: the live view prints one line per second'
        return Finding('terminal', 'warning', found, 'use a terminal with colours')
    width = shutil.get_terminal_size().columns
    if width < NARROWEST_TERMINAL:
        return Finding('terminal', 'warning', f'{width} columns', f'make it {NARROWEST_TERMINAL} wide or more')
    return Finding('terminal', 'ok', f'{environment["TERM"]}, {width} columns, {stream.encoding}')


CHECKS: tuple[Callable[[], Finding], ...] = (
    python,
    packages,
    share,
    run_directory,
    log_directory,
    domain,
    cores,
    memory,
    governor,
    disk,
    terminal,
    cameras,
    serial_ports,
    torch,
    ros,
)


def _access(name: str, text: str, nodes: Sequence[Path], group: str) -> Finding:
    closed = [node for node in nodes if not os.access(node, os.R_OK | os.W_OK)]
    if not closed:
        return Finding(name, 'ok', text)
    remedy = f'sudo usermod -aG {group} $USER, then log in again'
    if _member(group):
        remedy = f'you were added to group {group} after you logged in: log in again'
    return Finding(name, 'warning', f'{text}; no permission for {", ".join(node.name for node in closed)}', remedy)


def _member(group: str) -> bool:
    """Whether the user database lists this user in the group, even if this login session does not have it yet."""
    try:
        return os.environ.get('USER', '') in grp.getgrnam(group).gr_mem
    except KeyError:
        return False


def _card(folder: Path) -> str:
    try:
        return f'({(folder / "name").read_text(encoding="utf-8", errors="replace").strip()})'
    except OSError:
        return ''


def _links(folder: Path) -> list[str]:
    return sorted(link.name for link in folder.iterdir()) if folder.is_dir() else []


def _meminfo(file: Path) -> dict[str, float]:
    try:
        lines = file.read_text(encoding='ascii').splitlines()
    except OSError:
        return {}
    return {words[0].rstrip(':'): int(words[1]) * 1024.0 for words in map(str.split, lines)}


def _importable(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def _import_error(module: str) -> str:
    """Why a package that is there cannot be imported; empty: it can."""
    try:
        importlib.import_module(module)
    except Exception as error:  # noqa: BLE001 - a broken package may raise anything
        return str(error).partition('\n')[0] or type(error).__name__
    return ''


def _pip(action: str, names: Sequence[str]) -> str:
    return f'{sys.executable} -m pip {action} {" ".join(names)}'


def _version(distributions: Sequence[str]) -> str:
    for name in distributions:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            return importlib.metadata.version(name)
    return '(unknown version)'
