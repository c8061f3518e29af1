"""What each viewer is sent: the newest, as fast as it draws, and nothing when it hangs."""

from __future__ import annotations

from tactile_nodes.web.packet import Packet
from tactile_nodes.web.viewers import HISTORY_PACKETS, IN_FLIGHT, STUCK_AFTER_S, Audience, Viewer


def newcomer() -> Viewer:
    return Audience().join(0.0)


def packet(number: int) -> Packet:
    return Packet(b'body%d' % number, b'|%d' % number)


def sent(viewer: Viewer, packets: int) -> Viewer:
    for number in range(packets):
        viewer.offer(packet(number))
        viewer.take()
    return viewer


def test_a_viewer_that_draws_what_it_gets_gets_every_packet_once() -> None:
    viewer = newcomer()
    for number in range(10):
        viewer.offer(packet(number))
        assert viewer.take() == b'body%d|%d' % (number, number)
        assert viewer.take() is None
        viewer.acknowledge(0.1 * number)
    assert (viewer.sent, viewer.passed_over) == (10, 0)


def test_a_viewer_that_has_not_drawn_is_sent_no_more() -> None:
    viewer = sent(newcomer(), 5)
    assert viewer.sent == IN_FLIGHT
    assert not viewer.has_room


def test_a_slow_viewer_gets_the_newest_picture_and_all_samples() -> None:
    viewer = sent(newcomer(), 5)
    viewer.acknowledge(1.0)
    assert viewer.take() == b'body4|2|3|4'
    assert viewer.passed_over == 2


def test_a_viewer_that_hangs_keeps_a_minute_of_samples_and_no_more() -> None:
    viewer = newcomer()
    for number in range(3 * HISTORY_PACKETS):
        viewer.offer(Packet(b'', b'%08d' % number))
        viewer.take()
    viewer.acknowledge(1.0)
    message = viewer.take()
    assert message is not None
    assert len(message) == 8 * HISTORY_PACKETS
    assert message.endswith(b'%08d' % (3 * HISTORY_PACKETS - 1))


def test_a_viewer_that_hangs_is_not_watching_until_it_comes_back() -> None:
    viewer = sent(newcomer(), IN_FLIGHT)
    assert viewer.is_watching(STUCK_AFTER_S - 0.1)
    assert not viewer.is_watching(STUCK_AFTER_S + 0.1)
    viewer.acknowledge(100.0)
    assert viewer.is_watching(1000.0)


def test_whoever_comes_later_is_reported_the_course_of_the_force() -> None:
    audience = Audience()
    audience.join(0.0)
    for number in range(3):
        audience.offer(packet(number))
    late = audience.join(1.0)
    audience.offer(packet(3))
    assert late.take() == b'body3|0|1|2|3'


def test_an_audience_of_those_who_hang_needs_no_packet() -> None:
    audience = Audience()
    assert not audience.has_room
    stuck = audience.join(0.0)
    assert audience.has_room
    for number in range(IN_FLIGHT):
        audience.offer(packet(number))
        stuck.take()
    assert not audience.has_room
    assert audience.watching(STUCK_AFTER_S + 1) == 0


def test_more_viewers_than_allowed_find_it_full() -> None:
    audience = Audience(most=1)
    viewer = audience.join(0.0)
    assert audience.is_full
    audience.leave(viewer)
    assert not audience.is_full


def test_the_course_of_the_force_goes_on_while_nobody_can_be_shown_anything() -> None:
    audience = Audience()
    audience.remember(b'|0')
    watching = audience.join(0.0)
    audience.remember(b'|1')
    late = audience.join(1.0)
    audience.offer(packet(2))
    assert watching.take() == late.take() == b'body2|0|1|2'


def test_a_page_that_was_hidden_gets_no_packet_of_that_time_but_its_samples() -> None:
    """Another page was watched meanwhile, and closed hours ago: nothing newer was offered since."""
    viewer = sent(newcomer(), IN_FLIGHT + 1)
    viewer.acknowledge(3600.0)
    assert viewer.take() is None
    viewer.offer(packet(9))
    assert viewer.take() == b'body9|2|9'
