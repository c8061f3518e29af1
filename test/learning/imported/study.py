"""Calibration by images and a table, if the camera moves or the gel has sides.

    PYTHONPATH=. python test/learning/imported/study.py before 0 0.001 0.003 0.015 0.05
    PYTHONPATH=. python test/learning/imported/study.py force 0 0.001 0.003 0.01 0.03
    PYTHONPATH=. python test/learning/imported/study.py sides ignored free held

The first moves it before the second half of the presses, the second with each newton. The third moves nothing: the gel
has sides that its description ignores.

For each motion (mm along the surface) it prints how far a model, calibrated with 40 presses, is off on held-out ones.
Before the second half: with an image of the untouched gel before each press, and without. With the force: also how far
live sensing with that model is off, on the same sensor.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.stability.chain import Chain
from tactile_nodes.cli.main import main
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

SCENE = {'gel': Gel(seed=808, shear_modulus_mpa=0.16)}
PRESSES, RESTS, FRAMES, FRAME_NS = 40, 20, 3, 50_000_000
Shift = Callable[[int, float], float]
"""The motion of the camera (mm) by the number of the press and its force (N)."""


def seen(shift_mm: float) -> Optics:
    """The gel under a camera that has moved."""
    return Optics(replace(SCENE['gel'], camera_shift_mm=(shift_mm, 0.3 * shift_mm)), contact_table(SCENE['gel']))


def pressed(seed: int) -> list[tuple[Press, float]]:
    """Random presses with their forces (N)."""
    random, table = np.random.default_rng(seed), contact_table(SCENE['gel'])
    drawn = [(*random.uniform(-13, 13, 2).tolist(), random.uniform(0.3, 2.0)) for _ in range(PRESSES)]
    return [(Press(*each), table.force_at(each[2])) for each in drawn]


def calibrate(folder: Path, model: str, untouched: Shift, under_force: Shift, *, before: bool = True) -> Path:
    """Render the presses, and calibrate the model with them; the calibrated model."""
    rows = ['picture,x_mm,y_mm,force_n']

    def add(name: str, image: np.ndarray, values: str = ',,0') -> None:
        cv2.imwrite(str(folder / name), image)
        rows.append(f'{name},{values}')

    for number in range(RESTS):
        add(f'rest_{number}.png', seen(0.0).render((), number))
    for number, (press, force_n) in enumerate(pressed(1)):
        if before:
            add(f'before_{number}.png', seen(untouched(number, 0.0)).render((), 1000 + number))
        image = seen(under_force(number, force_n)).render((press,), 2000 + number)
        add(f'press_{number}.png', image, f'{press.x_mm:.2f},{press.y_mm:.2f},{force_n:.4f}')
    (folder / 'presses.csv').write_text('\n'.join(rows) + '\n', encoding='utf-8')
    made = folder / f'{model}.safetensors'  # not one name for all: the chain keeps what it has read
    told = io.StringIO()
    words = ['--pictures', str(folder / 'presses.csv'), '--model', model, '--gel', 'moved', '--force']
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(io.StringIO()):
        main(['calibrate', *words, '-o', str(made)])
    print(*(line for line in told.getvalue().splitlines() if line.startswith(('after', 'the mounting'))), sep='\n')
    return made


def live(model: Path, under_force: Shift) -> None:
    """Print how far live sensing is off on other presses, and how many of its forces are ok."""
    chain, stamp_ns, off, ok = Chain(str(model), compiled=True), 10**12, [], 0
    crop = load_crop(seen(0.0).render((), 0))

    def read(image: np.ndarray) -> tuple[float, bool]:
        nonlocal stamp_ns
        stamp_ns += FRAME_NS
        told = chain.read(stamp_ns, np.ascontiguousarray(image[crop]))
        return told.total, told.status == told.STATUS_OK

    for number in range(RESTS):
        read(seen(0.0).render((), 5000 + number))
    for number, (press, force_n) in enumerate(pressed(2)):
        for frame in range(FRAMES):
            read(seen(0.0).render((), 6000 + FRAMES * number + frame))
        camera = seen(under_force(number, force_n))
        for frame in range(FRAMES):
            total, is_ok = read(camera.render((press,), 7000 + FRAMES * number + frame))
        off.append(total - force_n)
        ok += is_ok
    off_mn = 1e3 * np.abs(off)
    print(
        f'live: force RMSE {np.sqrt(np.mean(np.square(off_mn))):.1f} mN, median {np.median(off_mn):.1f} mN, '
        f'{100 * ok / PRESSES:.0f} % ok'
    )


def load_crop(image: np.ndarray) -> tuple[slice, slice]:
    """The central 440x440 px."""
    top, left = ((side - 440) // 2 for side in image.shape)
    return slice(top, top + 440), slice(left, left + 440)


def study(what: str, word: str) -> None:
    """Print the errors for one motion of the camera, or one kind of sides."""
    mm = 0.0 if what == 'sides' else float(word)
    if what == 'sides':
        SCENE['gel'] = replace(SCENE['gel'], sides=word)
    with tempfile.TemporaryDirectory() as made:
        os.environ['TACTILE_GELS'] = str(Path(made) / 'gels.sqlite')  # and not the list of whoever runs this
        if what == 'before':
            half: Shift = lambda number, _: mm if number >= PRESSES // 2 else 0.0  # noqa: E731
            for before in (True, False):
                print(f'--- moved by {mm} mm, {"with" if before else "without"} an image before each press', flush=True)
                calibrate(Path(made), 'portable', half, half, before=before)
            return
        for model in ('portable', 'field'):
            print(f'--- {model}, {f"sides {word}" if what == "sides" else f"{mm} mm per newton"}', flush=True)
            live(calibrate(Path(made), model, lambda *_: 0.0, lambda _, n: mm * n), lambda _, n: mm * n)


if __name__ == '__main__':
    for text in sys.argv[2:]:
        study(sys.argv[1], text)
