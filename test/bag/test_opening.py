"""How a recording begins: at one moment on all topics."""

from __future__ import annotations

from tactile_nodes.bag.opening import PATIENCE_S, Arrival, Opening

BEGUN_NS = 10**12
MS = 1_000_000


def arrival(topic: str, number: int, at_ms: int, said_ms: int | None = None) -> Arrival:
    source_ns = BEGUN_NS + (at_ms if said_ms is None else said_ms) * MS
    return Arrival(topic, f'{topic}.1', number, source_ns, BEGUN_NS + at_ms * MS, None)


def opening(*awaited: str, latched: tuple[str, ...] = ()) -> Opening:
    made = Opening(BEGUN_NS)
    for topic in (*awaited, *latched):
        made.expect(topic, latched=topic in latched, awaited=True)
    return made


def written(made: Opening) -> list[tuple[str, int, int]]:
    """Topic, number, and time of receipt in ms since the recorder was started."""
    return [(each.topic, each.sequence, (log_ns - BEGUN_NS) // MS) for each, log_ns in made.release()]


def test_it_is_over_when_something_has_come_of_every_topic() -> None:
    made = opening('/image', '/info')
    made.hold(arrival('/image', 7, 10))
    assert (made.is_over(BEGUN_NS + 10 * MS), made.silent) == (False, ['/info'])
    made.hold(arrival('/info', 7, 60))
    assert made.is_over(BEGUN_NS + 60 * MS)


def test_a_topic_that_is_silent_is_not_waited_for_without_end() -> None:
    made = opening('/image')
    assert not made.is_over(BEGUN_NS + round(PATIENCE_S * 1000) * MS - 1)
    assert made.is_over(BEGUN_NS + round(PATIENCE_S * 1000) * MS)


def test_what_came_before_the_last_topic_was_heard_goes() -> None:
    made = opening('/image', '/info')
    for number in range(5):
        made.hold(arrival('/image', 100 + number, 20 * number))
    made.hold(arrival('/info', 103, 61))
    made.hold(arrival('/info', 104, 81))
    assert made.begin_ns == BEGUN_NS + 61 * MS
    assert written(made) == [('/image', 104, 80), ('/info', 103, 61), ('/info', 104, 81)]


def test_nothing_goes_when_all_was_heard_from_its_first_message_on() -> None:
    # As in a replay: nothing had come before of what is played, whatever other nodes say of themselves.
    made = opening('/image', '/force')
    made.hold(arrival('/diagnostics', 40, 10))
    for number in range(1, 4):
        made.hold(arrival('/image', number, 20 * number))
    made.hold(arrival('/force', 1, 90))
    whole = [('/image', 1, 20), ('/image', 2, 40), ('/image', 3, 60), ('/force', 1, 90)]
    assert written(made) == [('/diagnostics', 40, 10), *whole]


def test_what_begins_because_it_is_listened_to_does_not_begin_before_the_others() -> None:
    made = opening('/wrench', '/image')
    made.hold(arrival('/wrench', 1, 20))
    made.hold(arrival('/image', 500, 1640))
    made.hold(arrival('/wrench', 98, 1645))
    assert written(made) == [('/image', 500, 1640), ('/wrench', 98, 1645)]


def test_the_first_press_of_a_plan_is_never_left_out() -> None:
    made = opening('/image')
    made.hold(arrival('/press', 1, 20))
    made.hold(arrival('/image', 500, 40))
    assert written(made) == [('/press', 1, 20), ('/image', 500, 40)]


def test_what_latched_topics_said_before_stands_first_and_at_the_beginning() -> None:
    made = opening('/image', latched=('/rest',))
    made.hold(arrival('/image', 30, 20))
    made.hold(arrival('/rest', 1, 500, said_ms=-60_000))
    assert written(made) == [('/rest', 1, 20), ('/image', 30, 20)]


def test_what_a_latched_topic_says_meanwhile_keeps_its_time() -> None:
    made = opening('/image', latched=('/rest',))
    made.hold(arrival('/image', 1, 20))
    made.hold(arrival('/rest', 1, 300, said_ms=299))
    assert sorted(written(made), key=lambda entry: entry[2]) == [('/image', 1, 20), ('/rest', 1, 300)]
