"""What the service says of ICE servers is what the page understands."""

from __future__ import annotations

from page_steps import Open

from app.api.whep import _ice_links
from app.config import IceServer

READ = "link => import('/static/whep.js').then(({ iceServersOf }) => iceServersOf(link))"


def test_links_of_the_service_are_understood(open_page: Open) -> None:
    password = 'a"b\\c\\"; rel="x", <turn:evil>'
    stun = IceServer(urls="stun:stun.example.org:3478")
    turn = IceServer(
        urls=["turn:a.example.org?transport=udp", "turns:b.example.org"], username="u", credential=password
    )
    header = ", ".join([*_ice_links(stun), *_ice_links(turn)])  # as fetch joins them
    with open_page() as page:
        assert page.evaluate(READ, header) == [
            {"urls": "stun:stun.example.org:3478"},
            {"urls": "turn:a.example.org?transport=udp", "username": "u", "credential": password},
            {"urls": "turns:b.example.org", "username": "u", "credential": password},
        ]
        assert page.evaluate(READ, '<https://x.example>; rel="license", <stun:s>; rel=ice-server') == [
            {"urls": "stun:s"}
        ]
        assert page.evaluate(READ, None) == []
