from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from shifting import shifted

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod


@pytest.fixture
def dis(speckle: np.ndarray) -> FlowMethod:
    """With the speckle as its rest image."""
    flow = make_flow('dis')
    flow.set_reference(speckle)
    return flow


def middle_of(flow: FlowMethod, image: np.ndarray) -> np.ndarray:
    return flow.displacement(image).displacement_px[40:-40, 40:-40]


def test_dis_reads_a_shift_to_the_right_and_up_with_its_signs(dis: FlowMethod, speckle: np.ndarray):
    middle = middle_of(dis, shifted(speckle, 1.5, -0.8))
    np.testing.assert_allclose(middle.mean(axis=(0, 1)), [1.5, -0.8], atol=0.05)


def test_dis_reads_a_tenth_of_a_pixel(dis: FlowMethod, speckle: np.ndarray):
    middle = middle_of(dis, shifted(speckle, 0.1, 0.0))
    assert middle[..., 0].mean() == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize('light', [0.5, 0.7, 0.9, 1.1])
def test_more_or_less_light_is_no_motion_for_dis(dis: FlowMethod, speckle: np.ndarray, light: float):
    """Nothing that moved by 1.5 and -0.8 px moves otherwise in another light (half of it: 1.67 px if uncorrected)."""
    image = np.clip(np.round(shifted(speckle, 1.5, -0.8) * light), 0, 255).astype(np.uint8)
    middle = middle_of(dis, image)
    np.testing.assert_allclose(middle.mean(axis=(0, 1)), [1.5, -0.8], atol=0.03)
    assert middle.std(axis=(0, 1)).max() < 0.03  # 0.17 px uncorrected


def test_what_is_bright_in_one_place_is_no_light_for_dis(dis: FlowMethod, speckle: np.ndarray):
    spot = speckle.copy()
    spot[:60, :60] = 255
    np.testing.assert_array_equal(dis.displacement(spot).displacement_px[200:, 200:], 0)


def test_displacement_is_float32_per_pixel(dis: FlowMethod, speckle: np.ndarray):
    field = dis.displacement(speckle)
    assert field.displacement_px.dtype == np.float32
    assert field.displacement_px.shape == (440, 440, 2)


def test_another_process_gets_the_same_bits(speckle: np.ndarray, tmp_path):
    program = (
        'import sys, numpy as np, hashlib\n'
        'from tactile_nodes.sensing.flow.choice import make_flow\n'
        'flow = make_flow("dis"); images = np.load(sys.argv[1])\n'
        'flow.set_reference(images[0])\n'
        'print(hashlib.sha256(flow.displacement(images[1]).displacement_px.tobytes()).hexdigest())\n'
    )
    np.save(tmp_path / 'images.npy', np.stack([speckle, shifted(speckle, 0.4, -1.1)]))
    command = [sys.executable, '-c', program, str(tmp_path / 'images.npy')]
    answers = {subprocess.run(command, check=True, capture_output=True, text=True).stdout for _ in range(2)}
    assert len(answers) == 1


def test_a_colour_image_is_refused():
    with pytest.raises(ImageError, match='8 bit grey'):
        make_flow('dis').set_reference(np.zeros((440, 440, 3), np.uint8))


def test_an_image_too_small_for_patches_is_refused():
    with pytest.raises(ImageError, match='at least 32x32'):
        make_flow('dis').set_reference(np.zeros((16, 16), np.uint8))


def test_an_unknown_method_is_refused_with_those_there_are():
    with pytest.raises(ConfigurationError, match="no flow method 'magic'; use one of: dis"):
        make_flow('magic')


@pytest.mark.parametrize(
    'options', [{'speed': 1}, {'preset': 3}, {'threads': True}, {'preset': 'slow'}, {'threads': None}]
)
def test_wrong_options_are_refused(options: dict[str, object]):
    with pytest.raises(ConfigurationError):
        make_flow('dis', options)


def test_options_are_recorded_with_their_defaults():
    assert make_flow('dis', {'finest_scale': None}).options == {
        'preset': 'ultrafast',
        'finest_scale': None,
        'patch_size': None,
        'patch_stride': None,
        'gradient_descent_iterations': None,
        'variational_refinement_iterations': None,
        'threads': 1,
    }


def test_the_number_of_threads_does_not_change_a_bit(speckle: np.ndarray):
    image = shifted(speckle, 0.6, 0.2)
    results = []
    for threads in (1, 2):
        flow = make_flow('dis', {'threads': threads})
        flow.set_reference(speckle)
        results.append(flow.displacement(image).displacement_px)
    np.testing.assert_array_equal(*results)


@pytest.mark.shared_data
@pytest.mark.parametrize(('frame', 'shift'), [('04', 0.4), ('08', 0.8), ('10', 1.0)])
def test_somebody_elses_speckle_moves_as_commanded(shared_data: Path, frame: str, shift: float):
    """Shifts right and up; DIS reads 0.43 and 0.81 where 0.4 and 0.8 were commanded, as others found too."""
    rest, image = (
        cv2.imread(str(shared_data / 'dic_rigid_shift' / f'rigid_cam0_frame{each}.tiff'), cv2.IMREAD_GRAYSCALE)
        for each in ('00', frame)
    )
    flow = make_flow('dis')
    flow.set_reference(rest)
    middle = flow.displacement(image).displacement_px[50:-50, 50:-50]
    np.testing.assert_allclose(middle.mean(axis=(0, 1)), [shift, -shift], atol=0.04)
