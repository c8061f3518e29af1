"""Checks, before a fit, whether there are enough samples for it."""

from __future__ import annotations

from tactile_nodes.errors import TooFewPressesError

LEAST_UNTOUCHED = 12
MORE_UNTOUCHED = (
    'take more of the untouched gel: into the table, or from the same bags (tactile dataset build … '
    '--without-contact 0.2)'
)


def require_enough(aim: str, untouched: int, presses: int, least_presses: int, or_else: str = '') -> None:
    """Raise an error if there are too few samples for `aim`. `or_else` names another remedy if presses are missing.

    Raises:
        TooFewPressesError: names what is missing and how many.
    """
    lacking = [
        (LEAST_UNTOUCHED - untouched, 'images of the untouched gel'),
        (least_presses - presses, 'presses'),
    ]  # fmt: skip
    missing = ' and '.join(f'{count} {name}' for count, name in lacking if count > 0)
    if missing:
        mends = [
            'record more',
            or_else if presses < least_presses else '',
            MORE_UNTOUCHED if untouched < LEAST_UNTOUCHED else '',
        ]
        raise TooFewPressesError(
            f'{aim} needs at least {LEAST_UNTOUCHED} images of the untouched gel and {least_presses} presses to train '
            f'on, but without the test set there are {untouched} and {presses}: {missing} are missing; '
            + ', or '.join(filter(None, mends))
        )
