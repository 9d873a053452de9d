"""The change between idle clip and live picture, as it is seen: `bench seams` in short, without its limits of time."""

from __future__ import annotations

import statistics

from page_steps import LONG, Open, say, wait_for_state

from bench.seams import closed_level, looks, seams, watch


def test_the_picture_goes_on_across_the_seams(open_page: Open) -> None:
    with open_page() as page:
        watch(page)
        page.wait_for_timeout(2000)
        idle = looks(page)
        for text in ("One.", "Two.", "Three."):
            say(page, text)
            wait_for_state(page, "idle")
            page.wait_for_timeout(700)
        seen = looks(page)
    found = list(seams(seen))
    assert [seam.to_live for seam in found] == [True, False] * 3
    for to_live in (True, False):
        assert statistics.median(abs(seam.phase) for seam in found if seam.to_live is to_live) < 3
    light = statistics.median(look.light for look in idle if look.light is not None)
    assert min(seam.darkest for seam in found) > 0.9 * light
    assert max(look.moved for look in idle if look.moved is not None) > 0  # what is measured below can be seen
    assert statistics.median(seam.moved for seam in found) < 2  # pixels; half a loop away it is up to 5


def test_she_stops_with_her_mouth_closing(open_page: Open) -> None:
    with open_page() as page:
        watch(page)
        page.evaluate("probe.lookAtMouths()")
        say(page, "That is a question.")
        wait_for_state(page, "idle")
        page.wait_for_timeout(300)
        closed = closed_level(looks(page))
        say(page, LONG)
        page.wait_for_timeout(1500)
        looks(page)
        stopped = page.evaluate("(open) => probe.interrupt(open)", 6 * closed)
        wait_for_state(page, "idle")
        page.wait_for_timeout(300)
        mouths = [look.apart for look in looks(page) if look.live and look.apart is not None and look.at >= stopped]
    # It is neither frozen open nor shut from one picture to the next.
    assert mouths[-1] < 3 * closed
    assert any(3 * closed < mouth < 0.9 * mouths[0] for mouth in mouths)
