from __future__ import annotations

import io

import pytest
from patterns import Studio

from app.stream.push.pipe import PublishOrder, pack_packet, read_order, read_packet

ORDER = PublishOrder("rtmp", "rtmp://host/app/käy", "", b"\0head\xff", b"\0\0\1\x67", 2.5)


def test_an_order_and_packets_come_through() -> None:
    packets = Studio().frames(3)
    pipe = io.BytesIO(ORDER.pack() + b"".join(map(pack_packet, packets)))
    assert read_order(pipe) == ORDER
    assert [read_packet(pipe) for _ in packets] == packets
    assert read_packet(pipe) is None
    assert {packet.kind for packet in packets} == {"video", "opus", "aac"}
    assert any(packet.pts < 0 for packet in packets)


@pytest.mark.parametrize("size", [0, 3, 4, 20])
def test_an_order_that_breaks_off_is_none(size: int) -> None:
    assert read_order(io.BytesIO(ORDER.pack()[:size])) is None


@pytest.mark.parametrize("size", [5, 60])
def test_a_packet_that_breaks_off_is_none(size: int) -> None:
    assert read_packet(io.BytesIO(pack_packet(Studio().frame()[0])[:size])) is None
