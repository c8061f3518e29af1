"""The gel's force beside another one: ratio, its error, what is no evidence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes.sensing.judge.force_check import (
    ContactFrames,
    ContactSplitter,
    ForceComparison,
    ForceRatio,
    Scale,
    UnlikeContacts,
)

S = 1_000_000_000
ZERO = (3.0, -1.0, 12.0)
"""An independent sensor that nobody tared."""


def pressed(time_s: float, begins_s: float) -> float:
    """A contact of one second that rises to 1 N and falls again."""
    share = time_s - begins_s
    return max(0.0, math.sin(math.pi * share)) if 0 <= share <= 1 else 0.0


def compared(gain: float, contacts: int, *, delay_s: float = 0.0, noise: float = 0.0) -> ForceRatio | None:
    """Contacts every 2 s, as a gel with a gain at 60 Hz and an independent sensor at 200 Hz see them."""
    comparison, splitter, ratio = ForceComparison(), ContactSplitter(), None
    random = np.random.default_rng(4)
    for contact in range(contacts):
        begin_s = 2.0 * contact
        for step in range(400):
            time_s = begin_s + step / 200
            force_n = pressed(time_s, begin_s + 0.7)
            direction = (0.6 * force_n, 0.0, -0.8 * force_n)
            comparison.independent(round(time_s * S), tuple(z + d for z, d in zip(ZERO, direction, strict=True)))
        for step in range(120):
            time_s = begin_s + step / 60
            read = gain * pressed(time_s - delay_s, begin_s + 0.7) * (1 + noise * random.normal())
            ended = splitter.feed(round(time_s * S), read, 0.3, in_contact=read > 0.02, usable=True)
            if ended is not None:
                ratio = comparison.contact(ended) or ratio
    return ratio


def test_a_gel_that_reads_a_fifth_too_little_has_a_ratio_of_four_fifths() -> None:
    ratio = compared(0.8, 8)
    assert ratio is not None
    assert ratio.ratio == pytest.approx(0.8, rel=0.01)
    assert ratio.contacts == 8
    assert ratio.off == pytest.approx(-math.log(0.8), abs=0.01)


def test_a_delay_of_a_frame_is_no_drift() -> None:
    ratio = compared(1.0, 8, delay_s=1 / 60)
    assert ratio is not None
    assert abs(math.log(ratio.ratio)) < 0.01


def test_an_object_that_is_held_for_minutes_is_compared_from_before_it_was_touched() -> None:
    """The wrist sensor's zero is -10 N. After 30 s of a hold its mean is that of the load, which is no zero."""
    comparison, splitter, ratios = ForceComparison(), ContactSplitter(), []
    for step in range(6 * 100 * 20):
        time_s = step / 20
        force = 5.0 + math.sin(time_s) if time_s % 100 > 2 else 0.0  # held for 98 of 100 s
        stamp = step * S // 20
        comparison.independent(stamp, (0.0, 0.0, -10.0 - force))
        ended = splitter.feed(stamp, force, 0.1, in_contact=force > 0, usable=True)
        if ended is not None and (found := comparison.contact(ended)) is not None:
            ratios.append(found.ratio)
    assert ratios == pytest.approx([1.0, 1.0])  # from the fifth hold on


def test_a_load_cell_that_measures_one_axis_is_compared_too() -> None:
    """An axis that is not measured is NaN; so is all of a sample now and then."""
    comparison, splitter, ratios = ForceComparison(), ContactSplitter(), []
    for step in range(6 * 2 * 60):
        force = max(0.0, math.sin(math.pi * step / 60))  # a contact of one second, every two seconds
        stamp = step * S // 60
        comparison.independent(stamp, (math.nan, math.nan, 3.0 - force if step % 7 else math.nan))
        ended = splitter.feed(stamp, 0.8 * force, 0.1, in_contact=force > 0.03, usable=True)
        if ended is not None and (found := comparison.contact(ended)) is not None:
            ratios.append(found.ratio)
    assert ratios == pytest.approx([0.8], rel=0.01)  # of five contacts: nothing came before the first


def test_four_contacts_are_not_enough() -> None:
    assert compared(0.5, 4) is None
    assert compared(0.5, 5) is not None


def test_what_chance_explains_counts_as_nothing() -> None:
    assert ForceRatio(0.9, 0.04, 5).off == 0.0
    assert ForceRatio(0.9, 0.03, 5).off == pytest.approx(0.105, abs=0.001)


def test_the_standard_error_falls_with_the_number_of_contacts() -> None:
    few, many = compared(1.0, 5, noise=0.3), compared(1.0, 20, noise=0.3)
    assert few is not None
    assert many is not None
    assert many.sigma < few.sigma < 0.1


def test_frames_that_were_not_in_order_are_no_evidence() -> None:
    comparison = ForceComparison()
    for step in range(600):
        comparison.independent(step * S // 200, (0.0, 0.0, pressed(step / 200, 1.0)))
    stamps = [S + step * S // 60 for step in range(60)]
    contact = ContactFrames(stamps, [1.0] * 60, [0.1] * 60, [step % 2 == 0 for step in range(60)])
    assert comparison.contact(contact) is None


def test_a_scale_tells_the_mean_of_two_seconds_of_rest() -> None:
    scale = Scale()
    for step in range(180):
        scale.feed(step * S // 60, 1.96 + 0.01 * (step % 2), in_contact=True)
    assert scale.steady_n == pytest.approx((1.965, 0.005), abs=1e-4)
    scale.feed(3 * S, 0.0, in_contact=False)
    assert scale.steady_n is None


def test_a_weight_that_swings_is_not_weighed() -> None:
    scale = Scale()
    for step in range(120):
        scale.feed(step * S // 60, 2 + math.sin(step / 5), in_contact=True)
    assert scale.steady_n is None


@pytest.mark.parametrize(('unlike', 'of', 'bound'), [(20, 20, 0.747), (10, 20, 0.249), (19, 19, 0.0), (0, 50, 0.0)])
def test_share_of_unlike_contacts_has_wilsons_lower_bound(unlike: int, of: int, bound: float) -> None:
    """By hand for 20 of 20 and z = 2.6: (1 + 0.169 - 0.169) / 1.338 = 0.747."""
    contacts = UnlikeContacts()
    for number in range(of):
        contacts.contact(ContactFrames([0], [1.0], [2.0 if number < unlike else 0.5], [True]))
    assert contacts.at_least == pytest.approx(bound, abs=0.001)
