"""Errors on a gel that thirty presses of one body, or of two, have calibrated: the table of docs/contacts.md.

    PYTHONPATH=test python test/learning/field/study.py      # about a minute, the first time some more

Each line has the median errors of the total and of the centre, for the presses of each body.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from body_presses import BodySensor
from test_field_bodies import off

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.alone import transfer_alone
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.field.calibration import Pressed
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout

BODIES = {'punch:3': 9.5, 'square': 9.5, 'ring': 9.0}
"""How far from the middle (mm) each is pressed, with up to 2 N."""


def together(first: Dataset, second: Dataset, names: tuple[str, str]) -> Dataset:
    """The presses of two bodies as one data set, which names the body of each."""
    both = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ('features', 'presses', 'confidence')
    }
    rest = np.concatenate([first.rest, second.rest + len(first.confidence)])
    return replace(first, **both, rest=rest, indenter=np.repeat(names, [len(first.presses), len(second.presses)]))


def main() -> None:
    model = load_model(find_model('field'))
    presses = {
        name: BodySensor(name, 2.0, cells=48).presses(model, 30, reach_mm, seed)
        for seed, (name, reach_mm) in enumerate(BODIES.items(), 1)
    }

    def tell(by: str, readout: object) -> None:
        assert isinstance(readout, FieldReadout)
        errors = (off(readout, *each) for each in presses.values())
        print(f'{by:28}', *(f'{100 * total:5.1f} % {centre_mm:6.3f} mm' for total, centre_mm in errors))

    def fitted(dataset: Dataset, body: str = '') -> object:
        pressed = Pressed(body=KnownBody.named(body) if body else None)
        return transfer_alone(model, dataset, pressed, forced=True).readout

    print(f'{"calibrated by":28}', *(f'{name:>17}' for name in BODIES))
    tell('nothing', replace(model.model.readout, tips=None))  # type: ignore[type-var]
    for name, (dataset, _) in presses.items():
        tell(name, fitted(dataset, name))
    punch, ring = presses['punch:3'][0], presses['ring'][0]
    tell('punch and ring together', fitted(together(punch, ring, ('punch:3', 'ring'))))
    tell('punch, mistaken for the tip', fitted(punch, 'ball:0.6'))


if __name__ == '__main__':
    main()
