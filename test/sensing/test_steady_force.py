"""Forces of a steady contact are averaged over frames while pictures are noisy; of one that changes they are not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.sensing.explain.model import ForceMap
from tactile_nodes.sensing.explain.reading import Contact, spread_over_bins
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.judge.steady_force import (
    INTERVAL,
    LONGEST_NS,
    MOST_FRAMES,
    SHRUNK_BY,
    SteadyForce,
    steady,
)

BINS = BinGrid()
PERIOD_NS = 16_000_000
NOISE = 4.0
COURSES = 100


def errors(truth: np.ndarray, seed: int = 1) -> np.ndarray:
    """How far a number is off in each frame of courses of the truth with noise of 1; two others stand still."""
    random, off = np.random.default_rng(seed), []
    for _ in range(COURSES):
        seen = np.column_stack([truth, 0 * truth, 0 * truth]) + random.normal(size=(len(truth), 3))
        for now in range(len(truth)):
            last = seen[max(0, now - MOST_FRAMES + 1) : now + 1][::-1]
            off.append(steady(np.arange(len(last)) * 0.016, last, np.ones(3))[1][0] - truth[now])
    return np.array(off).reshape(COURSES, len(truth))


def rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.square(values).mean()))


def test_a_steady_force_is_half_as_noisy_after_eight_frames_and_never_noisier() -> None:
    """The mean of eight has a noise of 0.35; some of that goes where noise looks like a slope."""
    off = errors(np.zeros(MOST_FRAMES))
    by_frame = np.sqrt(np.square(off).mean(axis=0))
    assert by_frame[-1] < 0.55
    assert (by_frame[1:] < 0.9).all()


@pytest.mark.parametrize('rate', [0.1, 0.6, 2.0, 30.0])
def test_a_ramp_is_no_further_off_than_single_frames(rate: float) -> None:
    """A root mean square of 100 courses of 20 frames, which have frames in common, is off by 3 %."""
    assert rms(errors(rate * np.arange(20.0))) < 1.06


@pytest.mark.parametrize('size', [0.5, 2.0, 5.0, 50.0])
def test_a_step_is_no_further_off_than_single_frames(size: float) -> None:
    assert rms(errors(np.where(np.arange(16) < 8, 0.0, size))[:, 8:]) < 1.06


@pytest.mark.parametrize('height', [3.0, 30.0])
def test_a_slow_sine_is_hardly_further_off_than_single_frames(height: float) -> None:
    """One turn a second at 60 frames a second: it bends by (2 pi / 60)² of its height from frame to frame."""
    assert rms(errors(height * np.sin(np.arange(60) * 2 * np.pi / 60))) < 1.06


@given(
    seen=st.lists(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3), min_size=1, max_size=MOST_FRAMES),
    gaps_s=st.lists(st.floats(0.001, 0.4), min_size=MOST_FRAMES, max_size=MOST_FRAMES),
)
def test_whatever_comes_an_average_stays_near_the_frame_itself(seen: list[list[float]], gaps_s: list[float]) -> None:
    """The frame itself is where the line through two frames is now, with an interval of one standard deviation times
    INTERVAL about it. Each line's is no wider and meets it, and what shrinks its slope moves it by no more than
    sqrt(SHRUNK_BY) of the slope's noise, which is less than a frame's."""
    back_s = np.cumsum([0.0, *gaps_s])[: len(seen)]
    _, estimate, _ = steady(back_s, np.array(seen), np.ones(3))
    assert np.abs(estimate - seen[0]).max() <= 2 * INTERVAL + math.sqrt(SHRUNK_BY) + 1e-6


@given(
    number=st.floats(-10, 10),
    gaps_s=st.lists(st.floats(0.001, 0.4), min_size=MOST_FRAMES - 1, max_size=MOST_FRAMES - 1),
)
def test_what_does_not_change_is_told_as_it_is(number: float, gaps_s: list[float]) -> None:
    back_s = np.cumsum([0.0, *gaps_s])
    count, estimate, _ = steady(back_s, np.full((MOST_FRAMES, 3), number), np.ones(3))
    assert count == MOST_FRAMES
    assert estimate == pytest.approx(number, abs=1e-9)


def test_all_numbers_must_agree() -> None:
    """One jumps by ten times its noise: the others are not averaged over its jump, either."""
    seen = np.zeros((6, 3))
    seen[3:, 1] = 10.0
    assert steady(np.arange(6) * 0.016, seen, np.ones(3))[0] == 3


def test_what_is_not_known_to_be_noisy_is_averaged_with_nothing() -> None:
    count, estimate, _ = steady(np.arange(4) * 0.016, np.array([[1.0], [2.0], [1.0], [2.0]]), np.array([math.nan]))
    assert (count, estimate.tolist()) == (1, [1.0])


def force_map(
    *contacts: tuple[float, float, float], noise: float = NOISE, seed: int = 0, noise_n: float = 0.001
) -> ForceMap:
    """Contacts (x, y in mm, N) seen in a picture of some noise (times that of the training)."""
    random = np.random.default_rng(seed)
    told = tuple(Contact(*each, 0.02, 0.002, 0.005, noise_n) for each in contacts)
    forces = spread_over_bins(told, BINS)
    left = (noise * random.normal(size=400)).astype(np.float32)
    return ForceMap(
        forces, float(forces.sum()), float(forces.max()), contacts[0][:2], 1.0, told, 0.002, 0.02, 0.3, left
    )  # fmt: skip


def course(forces_n: list[float], steady_force: SteadyForce | None = None) -> list[tuple[ForceMap, float]]:
    """Frame by frame, 16 ms apart."""
    one = steady_force or SteadyForce()
    return [
        one.averaged(PERIOD_NS * number, force_map((1.0, -2.0, force), seed=number), BINS)
        for number, force in enumerate(forces_n)
    ]


def test_it_tells_over_which_time_it_averaged() -> None:
    assert [told for _, told in course([0.5] * 10)] == pytest.approx([0.016 * min(n, 7) for n in range(10)])


def test_forces_are_averaged_with_those_before() -> None:
    found, _ = course([0.500, 0.504])[-1]
    assert found.total_n == pytest.approx(0.502, abs=1e-4)


def test_total_peak_map_and_contacts_are_those_of_one_another() -> None:
    found, _ = course([0.500, 0.504, 0.498, 0.503])[-1]
    assert found.total_n == found.normal_force_n.sum(dtype=np.float64)
    assert found.total_n == pytest.approx(found.contacts[0].force_n, rel=1e-6)
    assert found.peak_n == found.normal_force_n.max()
    assert found.contact_mm == (found.contacts[0].x_mm, found.contacts[0].y_mm)


def test_a_mean_takes_away_what_noise_makes_of_the_uncertainty() -> None:
    """Of three frames two thirds of the variance by noise, here (1 mN)², and of no more than all of it."""
    one = SteadyForce()
    for number, force in enumerate([0.5000, 0.5004, 0.4998]):
        seen = force_map((1.0, -2.0, force), noise=2.0, seed=number, noise_n=0.0005)
        found, _ = one.averaged(PERIOD_NS * number, replace(seen, total_sigma_n=0.005), BINS)
    assert found.total_sigma_n == pytest.approx(math.sqrt(0.005**2 - 0.001**2 * 2 / 3), rel=0.01)
    assert (found.position_sigma_mm, found.unlikeness) == (0.02, 0.3)
    noisiest, _ = course([0.500, 0.504, 0.498])[-1]
    assert noisiest.total_sigma_n == pytest.approx(0.002 / math.sqrt(3), rel=0.01)


def test_a_contact_that_slides_is_told_where_it_is() -> None:
    """By 0.2 mm a frame, ten times the noise of a place: no line through all frames and no mean is further off."""
    one = SteadyForce()
    for number in range(8):
        found, _ = one.averaged(PERIOD_NS * number, force_map((0.2 * number, 0.0, 0.5), seed=number), BINS)
        assert found.contact_mm[0] == pytest.approx(0.2 * number, abs=0.02)


def test_a_picture_as_in_the_training_is_left_and_ends_what_was() -> None:
    one = SteadyForce()
    course([0.5, 0.5, 0.5], one)
    plain = replace(force_map((1.0, -2.0, 0.5)), left_over=None)
    assert one.averaged(PERIOD_NS * 3, plain, BINS)[0] is plain
    assert one.averaged(PERIOD_NS * 4, force_map((1.0, -2.0, 0.5), seed=9), BINS)[1] == 0.0


Next = Callable[[SteadyForce], tuple[ForceMap, float]]
AFTER: dict[str, Next] = {
    'a stamp of before': lambda one: one.averaged(PERIOD_NS, force_map((1.0, -2.0, 0.5), seed=9), BINS),
    'a stamp long after': lambda one: one.averaged(
        2 * PERIOD_NS + LONGEST_NS + 1, force_map((1.0, -2.0, 0.5), seed=9), BINS
    ),
    'another rest image': lambda one: one.averaged(
        3 * PERIOD_NS, force_map((1.0, -2.0, 0.5), seed=9), BINS, 'another'
    ),
    'one more contact': lambda one: one.averaged(
        3 * PERIOD_NS, force_map((1.0, -2.0, 0.5), (9.0, 8.0, 0.2), seed=9), BINS
    ),
}  # fmt: skip


@pytest.mark.parametrize('what', AFTER)
def test_it_begins_anew_after(what: str) -> None:
    one = SteadyForce()
    course([0.5, 0.5, 0.5], one)
    assert AFTER[what](one)[1] == 0.0


def test_a_contact_that_comes_is_no_noise() -> None:
    """What no press explains is another before it is there, so the first two frames differ by more than noise: taken
    for noise it would let the frame in which the contact came be averaged with those in which it is there."""
    one = SteadyForce()
    coming = force_map((1.0, -2.0, 0.47), noise=1.0, seed=8)
    coming = replace(coming, left_over=np.float32(9) + coming.left_over)
    there = [force_map((1.0, -2.0, 0.5), noise=1.0, seed=number) for number in range(4)]
    told = [one.averaged(PERIOD_NS * number, each, BINS)[1] for number, each in enumerate([coming, *there])]
    assert told[2:] == pytest.approx([PERIOD_NS * number * 1e-9 for number in (1, 2, 3)])


def test_what_is_forgotten_is_averaged_no_more() -> None:
    one = SteadyForce()
    course([0.5, 0.5, 0.5], one)
    one.forget()
    assert one.averaged(PERIOD_NS * 3, force_map((1.0, -2.0, 0.5), seed=9), BINS)[1] == 0.0


def test_a_frame_that_comes_twice_counts_once() -> None:
    one, again = SteadyForce(), SteadyForce()
    once = course([0.500, 0.504], one)[-1]
    course([0.500], again)
    second = force_map((1.0, -2.0, 0.504), seed=1)
    assert again.averaged(PERIOD_NS, second, BINS)[0].total_n == once[0].total_n
    assert again.averaged(PERIOD_NS, second, BINS)[0].total_n == once[0].total_n


def test_no_frame_is_older_than_the_longest_time_however_few_come() -> None:
    one, told = SteadyForce(), 0.0
    for number in range(12):
        _, told = one.averaged(number * 150_000_000, force_map((1.0, -2.0, 0.5), seed=number), BINS)
    assert told == pytest.approx(0.3)


def test_of_two_contacts_each_is_averaged_with_itself() -> None:
    """Now the one is the stronger and now the other."""
    one = SteadyForce()
    left, right = (-8.0, 0.0), (8.0, 0.0)
    for number, (a, b) in enumerate([(0.301, 0.300), (0.299, 0.302)]):
        strongest = sorted([(*left, a), (*right, b)], key=lambda each: -each[2])
        found, told = one.averaged(PERIOD_NS * number, force_map(*strongest, seed=number), BINS)
    assert told == pytest.approx(0.016)
    forces = {round(each.x_mm): each.force_n for each in found.contacts}
    assert forces == pytest.approx({-8: 0.3, 8: 0.301}, abs=1e-6)
    assert found.contacts[0].force_n >= found.contacts[1].force_n
