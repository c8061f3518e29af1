"""The launch of a calibration as a user starts it: a bag in, a model file out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_nodes.model_file import load_model

DOMAIN = 72


def launched(tmp_path: Path, bag: Path, model: Path, **rule: object) -> subprocess.CompletedProcess[str]:
    """`tactile launch calibrate` of a bag, to its end."""
    config = tmp_path / 'calibrate.yaml'
    numbers = ''.join(f'    rule.{name}: {value}\n' for name, value in rule.items())
    config.write_text(f'/**/calibrator:\n  ros__parameters:\n{numbers}', encoding='utf-8')
    given = {'bag': bag, 'model': model, 'gel': 'gel-7', 'folder': tmp_path / 'made', 'calibrate_config': config}
    words = [f'{name}:={value}' for name, value in given.items()]
    environment = {
        **os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_LOG_DIR': str(tmp_path / 'log'),
        'XDG_CACHE_HOME': str(tmp_path / 'cache'),
    }  # fmt: skip
    command = [sys.executable, '-m', 'tactile_nodes', 'launch', 'calibrate', *words]
    return subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=170, check=False
    )


@pytest.mark.timeout(180)  # a fit takes seconds of a processor, more of one with other work
def test_a_bag_becomes_a_calibration_and_the_launch_ends_by_itself(
    tmp_path: Path, other_bag: Path, first_model: Path
) -> None:
    ended = launched(tmp_path, other_bag, first_model, first=6, most=6)
    assert ended.returncode == 0, ended.stdout
    assert 'no more presses: the greatest number of 6 presses is reached' in ended.stdout
    assert 'no force estimator is running; to use it: tactile launch live model:=' in ended.stdout
    calibrated = load_model(tmp_path / 'made' / 'gel-7_01.safetensors')
    assert (calibrated.gel, calibrated.card['source']['gel']) == ('gel-7', 'first')
