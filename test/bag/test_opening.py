"""How a recording begins: at one moment on all topics."""

from __future__ import annotations

from tactile_nodes.bag.opening import PATIENCE_S, Arrival, Opening

BEGUN_NS = 10**12
MS = 1_000_000


def arrival(topic: str, number: int, at_ms: int, published_ms: int | None = None) -> Arrival:
    source_ns = BEGUN_NS + (at_ms if published_ms is None else published_ms) * MS
    return Arrival(topic, f'{topic}.1', number, source_ns, BEGUN_NS + at_ms * MS, None)


def opening(*awaited: str, latched: tuple[str, ...] = ()) -> Opening:
    opened = Opening(BEGUN_NS)
    for topic in (*awaited, *latched):
        opened.expect(topic, latched=topic in latched, awaited=True)
    return opened


def written(opened: Opening) -> list[tuple[str, int, int]]:
    """Topic, number, and time of receipt in ms since the recorder was started."""
    return [(each.topic, each.sequence, (log_ns - BEGUN_NS) // MS) for each, log_ns in opened.release()]


def test_it_is_over_when_something_has_come_of_every_topic() -> None:
    opened = opening('/image', '/info')
    opened.hold(arrival('/image', 7, 10))
    assert (opened.is_over(BEGUN_NS + 10 * MS), opened.silent) == (False, ['/info'])
    opened.hold(arrival('/info', 7, 60))
    assert opened.is_over(BEGUN_NS + 60 * MS)


def test_a_topic_that_is_silent_is_not_waited_for_without_end() -> None:
    opened = opening('/image')
    assert not opened.is_over(BEGUN_NS + round(PATIENCE_S * 1000) * MS - 1)
    assert opened.is_over(BEGUN_NS + round(PATIENCE_S * 1000) * MS)


def test_what_came_before_the_last_topic_was_received_goes() -> None:
    opened = opening('/image', '/info')
    for number in range(5):
        opened.hold(arrival('/image', 100 + number, 20 * number))
    opened.hold(arrival('/info', 103, 61))
    opened.hold(arrival('/info', 104, 81))
    assert opened.begin_ns == BEGUN_NS + 61 * MS
    assert written(opened) == [('/image', 104, 80), ('/info', 103, 61), ('/info', 104, 81)]


def test_nothing_goes_when_all_was_received_from_its_first_message_on() -> None:
    # As in a replay: nothing had come before of what is played, whatever other nodes say of themselves.
    opened = opening('/image', '/force')
    opened.hold(arrival('/diagnostics', 40, 10))
    for number in range(1, 4):
        opened.hold(arrival('/image', number, 20 * number))
    opened.hold(arrival('/force', 1, 90))
    complete = [('/image', 1, 20), ('/image', 2, 40), ('/image', 3, 60), ('/force', 1, 90)]
    assert written(opened) == [('/diagnostics', 40, 10), *complete]


def test_what_begins_because_it_is_listened_to_does_not_begin_before_the_others() -> None:
    opened = opening('/wrench', '/image')
    opened.hold(arrival('/wrench', 1, 20))
    opened.hold(arrival('/image', 500, 1640))
    opened.hold(arrival('/wrench', 98, 1645))
    assert written(opened) == [('/image', 500, 1640), ('/wrench', 98, 1645)]


def test_the_first_press_of_a_plan_is_never_left_out() -> None:
    opened = opening('/image')
    opened.hold(arrival('/press', 1, 20))
    opened.hold(arrival('/image', 500, 40))
    assert written(opened) == [('/press', 1, 20), ('/image', 500, 40)]


def test_what_latched_topics_said_before_stands_first_and_at_the_beginning() -> None:
    opened = opening('/image', latched=('/rest',))
    opened.hold(arrival('/image', 30, 20))
    opened.hold(arrival('/rest', 1, 500, published_ms=-60_000))
    assert written(opened) == [('/rest', 1, 20), ('/image', 30, 20)]


def test_what_a_latched_topic_says_meanwhile_keeps_its_time() -> None:
    opened = opening('/image', latched=('/rest',))
    opened.hold(arrival('/image', 1, 20))
    opened.hold(arrival('/rest', 1, 300, published_ms=299))
    assert sorted(written(opened), key=lambda entry: entry[2]) == [('/image', 1, 20), ('/rest', 1, 300)]
