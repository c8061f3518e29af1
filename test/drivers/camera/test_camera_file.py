"""Videos and folders of images."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactile_nodes import decoding
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame
from tactile_nodes.drivers.camera.file import natural_key
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import ConfigurationError, DeviceTimeoutError, ImageError

SHARED = Path(__file__).parents[3].parent / 'shared' / 'data' / 'gelsight_mini_videos'


def read_all(camera: Camera) -> list[Frame]:
    frames = []
    while (frame := camera.read(1.0)) is not None:
        frames.append(frame)
    return frames


def levels(frames: list[Frame]) -> list[int]:
    """The number drawn into each picture: its level is 20 + 10 * number, every other column 4 above."""
    return [round((float(frame.image.mean()) - 22) / 10) for frame in frames]


def opened(path: Path, clock: SteppedClock, **settings: object) -> Camera:
    return open_camera(CameraSettings(str(path), **{'fps': 50.0, **settings}), clock)


def test_a_video_gives_every_frame_once_also_to_a_reader_that_fell_behind_and_then_ends(
    video: Path, jumping: SteppedClock
) -> None:
    camera = opened(video, jumping)
    jumping.advance(1.0)
    assert levels(read_all(camera)) == list(range(8))
    assert camera.read(1.0) is None


def test_a_looping_video_starts_again(video: Path, jumping: SteppedClock) -> None:
    camera = opened(video, jumping, loop=True)
    frames = [camera.read(1.0) for _ in range(19)]
    assert levels(frames) == [*range(8), *range(8), *range(3)]
    assert [frame.sequence for frame in frames] == list(range(19))


def test_a_folder_is_read_in_the_order_of_the_numbers_and_other_files_are_passed_over(
    folder: Path, jumping: SteppedClock
) -> None:
    assert levels(read_all(opened(folder, jumping))) == list(range(12))


def test_names_are_sorted_as_people_sort_them() -> None:
    names = ['b1', 'a10', 'a9', 'A1', 'a', '7', 'a1b2', 'a1b10']
    assert sorted(names, key=natural_key) == ['7', 'a', 'A1', 'a1b2', 'a1b10', 'a9', 'a10', 'b1']


@pytest.mark.parametrize(
    ('source', 'settings', 'count', 'period_ns'),
    [
        pytest.param('video', {}, 8, 20_000_000, id='the rate of the file'),
        pytest.param('video', {'rate': 2.0}, 8, 10_000_000, id='the file speeded up'),
        pytest.param('folder', {'fps': 25.0}, 12, 40_000_000, id='the rate of the settings'),
    ],
)
def test_frame_k_is_stamped_start_plus_k_over_the_rate(
    request: pytest.FixtureRequest, jumping: SteppedClock,
    source: str, settings: dict[str, float], count: int, period_ns: int,
) -> None:  # fmt: skip
    camera = opened(request.getfixturevalue(source), jumping, **settings)
    start_ns = jumping.now_ns()
    assert [frame.stamp_ns - start_ns for frame in read_all(camera)] == [period_ns * k for k in range(count)]
    assert jumping.now_ns() - start_ns == period_ns * (count - 1)


def test_at_rate_zero_no_time_passes_and_stamps_still_increase(folder: Path, jumping: SteppedClock) -> None:
    start_ns = jumping.now_ns()
    frames = read_all(opened(folder, jumping, rate=0.0))
    assert jumping.now_ns() == start_ns
    assert [frame.stamp_ns - start_ns for frame in frames] == list(range(12))


def test_a_frame_that_was_waited_for_in_vain_comes_with_the_next_read(video: Path, jumping: SteppedClock) -> None:
    camera = opened(video, jumping, rate=0.01)
    assert levels([camera.read(1.0)]) == [0]
    with pytest.raises(DeviceTimeoutError, match='not due within 1 s'):
        camera.read(1.0)
    assert levels([camera.read(1.0)]) == [1]


@pytest.mark.parametrize(
    ('level', 'kind', 'expected'),
    [
        pytest.param(9, np.uint8, 9, id='grey'),
        pytest.param(0, np.uint8, 0, id='dark'),
        pytest.param(0x1234, np.uint16, 0x12, id='of 16 bits the upper 8'),
    ],
)
def test_a_grey_image_stays_grey_of_8_bits(
    tmp_path: Path, jumping: SteppedClock, level: int, kind: type, expected: int
) -> None:
    cv2.imwrite(str(tmp_path / 'a.png'), np.full((5, 7), level, kind))
    image = opened(tmp_path, jumping).read(1.0).image
    assert image.shape == (5, 7)
    assert (image == expected).all()


def test_an_empty_folder_is_refused(tmp_path: Path, jumping: SteppedClock) -> None:
    with pytest.raises(ImageError, match=r'contains no images; supported: \.bmp \.jpeg'):
        opened(tmp_path, jumping)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (cv2.imencode('.png', np.zeros((10, 20), np.uint8))[1].tobytes(), 'contains pictures of 64x48 and of 20x10'),
        (b'', r'3.png .it is not a readable picture'),
        (b'no image at all', r'3.png .it is not a readable picture'),
    ],
    ids=['of another size', 'empty', 'damaged'],
)
def test_an_image_that_does_not_fit_or_is_damaged_is_refused(
    folder: Path, jumping: SteppedClock, content: bytes, reason: str
) -> None:
    (folder / '3.png').write_bytes(content)
    camera = opened(folder, jumping)
    with pytest.raises(ConfigurationError, match=reason):
        read_all(camera)


@pytest.mark.parametrize('content', [b'', b'no video at all' * 100])
def test_a_file_that_is_no_video_is_refused(tmp_path: Path, jumping: SteppedClock, content: bytes) -> None:
    path = tmp_path / 'video.avi'
    path.write_bytes(content)
    with pytest.raises(ImageError, match=r'video.avi (cannot be read as a video|contains no picture)'):
        opened(path, jumping)


def test_a_video_whose_name_is_not_utf_8_is_refused(video: Path, jumping: SteppedClock) -> None:
    """FFmpeg would crash on it."""
    renamed = video.rename(video.with_name('pr\udce9ssion.avi'))
    with pytest.raises(ImageError, match='its name is not UTF-8; rename it'):
        opened(renamed, jumping)


def test_a_video_of_too_many_pixels_is_refused_before_it_is_decoded(
    video: Path, jumping: SteppedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decoding, 'LARGEST_SIDE', 55)  # 3025 pixels
    with pytest.raises(ImageError, match=r'video\.avi \(it has 64x48 pixels, more than the limit of '):
        opened(video, jumping)


def test_a_folder_without_a_rate_says_what_to_set(folder: Path, jumping: SteppedClock) -> None:
    with pytest.raises(ImageError, match='set fps of the camera'):
        opened(folder, jumping, fps=0.0)


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.is_dir(), reason='the recordings of other people are not here')
@pytest.mark.parametrize(
    ('name', 'count'),
    [
        ('cheese_tube/exp_num_1/camera_0.avi', 68),
        ('cheese_tube/exp_num_1/camera_2.avi', 68),
        ('ball_white_thread/exp_num_2/camera_0.avi', 231),
        ('ball_white_thread/exp_num_2/camera_2.avi', 231),
    ],
)
def test_a_real_recording_gives_the_frames_that_its_header_claims(name: str, count: int, jumping: SteppedClock) -> None:
    """The counts are those of the files' indices; 25 frames a second are 40 ms."""
    camera = opened(SHARED / name, jumping, loop=True, fps=0.0)
    frames = [camera.read(1.0) for _ in range(count + 2)]
    assert {frame.image.shape for frame in frames} == {(240, 320, 3)}
    assert {b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(frames)} == {40_000_000}
    assert (frames[count].image == frames[0].image).all()
    assert (frames[count + 1].image == frames[1].image).all()
    assert not (frames[count - 1].image == frames[0].image).all()


def test_a_recording_that_is_over_says_since_when_and_how_to_begin_again(video: Path, jumping: SteppedClock) -> None:
    camera = opened(video, jumping)
    assert camera.health == Health(Level.OK, f'playing {video}')
    read_all(camera)
    jumping.sleep_until(jumping.now_ns() + 19 * NS_PER_S)
    assert camera.read(1.0) is None
    health = camera.health
    assert health.level is Level.WARN
    assert health.message.startswith('recording ended 19 s ago; start again or set loop:=true to play it again (8 pict')
    assert health.message.endswith(f'{video})')


def test_a_folder_that_is_over_says_that_fps_sets_its_pace(folder: Path, jumping: SteppedClock) -> None:
    camera = opened(folder, jumping)
    read_all(camera)
    assert '12 pictures at 50 frames/s' in camera.health.message
    assert 'fps sets the pace of a folder' in camera.health.message
