"""H.264 network abstraction layer units: from Annex B start codes (RTP, x264) to length prefixes (FLV, MP4)."""

from __future__ import annotations

START_CODE = b"\x00\x00\x01"
_SPS, _PPS, _DELIMITER = 7, 8, 9


def units(data: bytes) -> list[bytes]:
    """The units of an Annex B byte stream, without start codes and padding; empty ones are left out.

    Emulation prevention guarantees that a start code never occurs inside a unit, and a unit never ends in a zero byte.
    """
    return [unit for part in data.split(START_CODE)[1:] if (unit := part.rstrip(b"\x00"))]


def unit_type(unit: bytes) -> int:
    """nal_unit_type: 1 a slice, 5 a slice of a key frame, 6 SEI, 7 SPS, 8 PPS, 9 delimiter."""
    return unit[0] & 0x1F


def length_prefixed(data: bytes) -> bytes:
    """Annex B to four-byte lengths; parameter sets are left out, since these formats carry them in their header."""
    kept = [unit for unit in units(data) if unit_type(unit) not in (_SPS, _PPS, _DELIMITER)]
    return b"".join(len(unit).to_bytes(4, "big") + unit for unit in kept)
