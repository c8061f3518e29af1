"""What `tactile doctor` finds, on machines made of temporary folders."""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from tactile_nodes.bus.zeromq.discovery import Meeting
from tactile_nodes.cli import doctor, view
from tactile_nodes.cli.doctor import checks
from tactile_nodes.cli.doctor.checks import Finding
from tactile_nodes.errors import BusError, ConfigurationError


def test_one_core_is_a_warning() -> None:
    assert checks.cores(1).level == 'warning'
    assert checks.cores(2) == Finding('cores', 'ok', '2')


def test_memory_is_read_in_kilobytes(tmp_path: Path) -> None:
    """1500000 kB are 1.536 GB; 500000 kB are 0.512 GB, less than the one that is asked for."""
    meminfo = tmp_path / 'meminfo'
    meminfo.write_text('MemTotal:  4000000 kB\nMemAvailable:  1500000 kB\nHugePages_Total: 0\n', encoding='ascii')
    assert checks.memory(meminfo) == Finding('memory', 'ok', '1.5 GB available of 4.1')
    meminfo.write_text('MemTotal:  4000000 kB\nMemAvailable:  500000 kB\n', encoding='ascii')
    assert checks.memory(meminfo).level == 'warning'
    assert checks.memory(tmp_path / 'none').level == 'ok'  # what cannot be read is no complaint


@pytest.mark.parametrize(
    ('governor', 'driver', 'level'),
    [
        ('performance', 'acpi-cpufreq', 'ok'),
        ('powersave', 'acpi-cpufreq', 'warning'),
        ('powersave', 'intel_pstate', 'ok'),  # follows the load under this name
    ],
)
def test_a_governor_that_keeps_the_clock_low_is_a_warning(
    tmp_path: Path, governor: str, driver: str, level: str
) -> None:
    (tmp_path / 'scaling_governor').write_text(f'{governor}\n', encoding='ascii')
    (tmp_path / 'scaling_driver').write_text(f'{driver}\n', encoding='ascii')
    assert checks.governor(tmp_path).level == level


def test_a_missing_package_is_a_problem_with_the_command_that_installs_it() -> None:
    finding = checks.packages({'numpy': ('numpy',), 'no_such_module': ('no-such-module',)})
    assert finding.level == 'problem'
    assert finding.found == 'missing: no-such-module'
    assert finding.remedy.endswith('-m pip install no-such-module')


def test_a_package_that_is_there_but_cannot_be_imported_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as an OpenCV for screens on a computer without one, or one that was built for another NumPy."""
    text = 'libGL.so.1: cannot open shared object file: No such file or directory'
    (tmp_path / 'an_opencv.py').write_text(f'raise ImportError({text!r})', encoding='ascii')
    monkeypatch.syspath_prepend(tmp_path)
    finding = checks.packages({'an_opencv': ('an-opencv',)})
    assert (finding.level, finding.found) == ('problem', f'cannot be imported: an_opencv ({text})')
    assert finding.remedy.endswith('-m pip install --force-reinstall an-opencv')


def test_the_versions_of_the_packages_are_reported() -> None:
    import numpy

    assert f'numpy {numpy.__version__}' in checks.packages().found


def test_every_package_that_an_install_needs_is_looked_for() -> None:
    """colcon installs none of them."""
    setup = (Path(__file__).parents[2] / 'setup.py').read_text(encoding='utf-8')
    needed = re.findall(r"'([\w-]+)>=", setup.partition('install_requires=[')[2].partition(']')[0])
    assert 'numpy' in needed
    assert set(needed) <= {name for names in checks.PACKAGES.values() for name in names}


def test_a_domain_out_of_range_is_a_problem() -> None:
    assert checks.domain({}).found.startswith('0 ')
    assert checks.domain({'ROS_DOMAIN_ID': '42'}).level == 'ok'
    for bad in ('233', '-1', 'robot'):
        assert checks.domain({'ROS_DOMAIN_ID': bad}).level == 'problem'


def test_ros_is_not_needed_and_a_half_of_it_is_a_warning() -> None:
    assert checks.ros({}, rclpy=False).level == 'ok'
    assert checks.ros({'ROS_DISTRO': 'jazzy'}, rclpy=True).found == 'jazzy, with rclpy'
    assert checks.ros({'ROS_DISTRO': 'jazzy'}, rclpy=False).level == 'warning'


def test_no_camera_is_a_warning_because_the_simulated_one_runs(tmp_path: Path) -> None:
    finding = checks.cameras(tmp_path, tmp_path)
    assert (finding.level, finding.found) == ('warning', 'none')


def test_cameras_are_named_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    dev, sysfs = tmp_path / 'dev', tmp_path / 'sys'
    (dev / 'v4l' / 'by-id').mkdir(parents=True)
    for number in (10, 2):
        (dev / f'video{number}').touch()
        (sysfs / f'video{number}').mkdir(parents=True)
        (sysfs / f'video{number}' / 'name').write_text(f'Camera {number}\n', encoding='utf-8')
    (dev / 'v4l' / 'by-id' / 'usb-ELP-video-index0').touch()
    assert checks.cameras(dev, sysfs) == Finding(
        'cameras', 'ok', 'video2 (Camera 2), video10 (Camera 10); by id: usb-ELP-video-index0'
    )


def closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may open everything, so the refusal is made here."""
    monkeypatch.setattr(os, 'access', lambda path, mode: False)


def test_a_camera_that_may_not_be_opened_says_how_to_join_its_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'video0').touch()
    closed(monkeypatch)
    finding = checks.cameras(tmp_path, tmp_path)
    assert finding.level == 'warning'
    assert 'no permission for video0' in finding.found
    assert 'sudo usermod -aG video $USER' in finding.remedy


def test_serial_ports_belong_to_another_group_and_none_is_no_complaint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert checks.serial_ports(tmp_path).level == 'ok'
    (tmp_path / 'ttyUSB0').touch()
    (tmp_path / 'ttyACM1').touch()
    assert checks.serial_ports(tmp_path) == Finding('serial ports', 'ok', 'ttyACM1, ttyUSB0')
    closed(monkeypatch)
    assert 'sudo usermod -aG dialout $USER' in checks.serial_ports(tmp_path).remedy


def test_a_run_folder_that_cannot_be_had_is_a_problem(tmp_path: Path) -> None:
    def refuse() -> Path:
        raise ConfigurationError('others may enter /x')

    assert checks.run_directory(refuse) == Finding(
        'run folder', 'problem', 'others may enter /x', 'set TACTILE_RUN_DIR to a folder of your own, mode 700'
    )
    assert checks.run_directory(lambda: Path('/tmp')).level == 'ok'


def test_a_log_folder_that_cannot_be_made_is_a_problem(tmp_path: Path) -> None:
    assert checks.log_directory(lambda: tmp_path / 'new' / 'log').level == 'ok'
    (tmp_path / 'file').touch()
    found = checks.log_directory(lambda: tmp_path / 'file' / 'log')
    assert (found.level, found.remedy) == ('problem', 'set ROS_LOG_DIR to a folder that you own')


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder near the root, wherever temporary files go."""
    with tempfile.TemporaryDirectory(dir='/tmp') as folder:
        yield Path(folder)


def test_a_run_folder_too_deep_for_sockets_is_a_problem(short_path: Path) -> None:
    """A socket's path may take 107 bytes, and the bus needs 25 of them: /d232/01234567.99999.sock"""
    fits, too_long = (short_path / ('x' * (length - 1 - len(os.fsencode(short_path)))) for length in (82, 83))
    for folder in (fits, too_long):
        folder.mkdir()
    assert checks.run_directory(fits.absolute).level == 'ok'
    Meeting('01234567', 232, fits).leave()
    assert 'too long' in checks.run_directory(too_long.absolute).found
    with pytest.raises(BusError, match='too long'):
        Meeting('01234567', 232, too_long)


def test_an_installation_without_a_model_is_a_problem(tmp_path: Path) -> None:
    (tmp_path / 'models').mkdir()
    assert checks.share(lambda: tmp_path).level == 'problem'
    (tmp_path / 'models' / 'paper.safetensors').touch()
    assert checks.share(lambda: tmp_path).found.endswith('models: paper')


def test_the_disk_is_reported_in_minutes_of_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """440 * 440 bytes 60 times a second are 697 MB a minute: 6.97 GB are ten minutes, 0.697 GB one."""
    usage = type('Usage', (), {'free': 6_969_600_000})
    monkeypatch.setattr(checks.shutil, 'disk_usage', lambda folder: usage)
    assert checks.disk(tmp_path) == Finding('disk', 'ok', f'7.0 GB free in {tmp_path}: 10 minutes of images')
    usage.free = 696_960_000
    assert checks.disk(tmp_path).level == 'warning'


def test_free_disk_of_a_folder_that_cannot_be_written_is_of_no_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checks.os, 'access', lambda folder, mode: False)  # root may write everywhere
    found = checks.disk(tmp_path)
    assert (found.level, found.found) == ('warning', f'{tmp_path} is not writable')
    assert 'record elsewhere' in found.remedy


def test_a_terminal_without_utf_8_is_a_warning() -> None:
    ascii_stream = io.TextIOWrapper(io.BytesIO(), encoding='ascii')
    assert checks.terminal(ascii_stream, {}).level == 'warning'
    assert checks.terminal(io.TextIOWrapper(io.BytesIO(), encoding='utf-8'), {}).level == 'ok'


class Terminal(io.TextIOWrapper):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ('environment', 'draws'), [({}, False), ({'TERM': 'dumb'}, False), ({'TERM': ''}, False), ({'TERM': 'xterm'}, True)]
)
def test_the_doctor_says_how_the_view_will_show(environment: dict[str, str], draws: bool) -> None:
    terminal = Terminal(io.BytesIO(), encoding='utf-8')
    assert view.can_draw(terminal, environment) == draws
    assert ('prints one line per second' in checks.terminal(terminal, environment).found) != draws


def test_only_problems_make_the_exit_status_one() -> None:
    ok, warning, problem = (Finding('x', level, '') for level in ('ok', 'warning', 'problem'))
    assert doctor.exit_status([ok, warning]) == 0
    assert doctor.exit_status([ok, problem]) == 1


def test_the_summary_names_what_to_mend_first() -> None:
    findings = [Finding('a', 'ok', ''), Finding('b', 'warning', ''), Finding('c', 'problem', '')]
    assert doctor.summary(findings).endswith('Fix first: c.')
    assert doctor.summary(findings[:2]).endswith('Warnings: b.')
    assert doctor.summary(findings[:1]) == 'All checks passed.'


def test_the_table_shows_texts_as_they_are() -> None:
    console = Console(file=io.StringIO(), width=120)
    doctor.show([Finding('torch', 'ok', 'no', "pip install 'tactile_nodes[train]'")], console)
    assert "pip install 'tactile_nodes[train]'" in console.file.getvalue()


def test_json_holds_every_finding(capsys: pytest.CaptureFixture[str]) -> None:
    status = doctor.run(argparse.Namespace(json=True))
    findings = json.loads(capsys.readouterr().out)
    assert len(findings) == len(checks.CHECKS)
    assert all(set(finding) == {'name', 'level', 'found', 'remedy'} for finding in findings)
    assert status == int(any(finding['level'] == 'problem' for finding in findings))
