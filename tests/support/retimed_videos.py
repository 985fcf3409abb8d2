"""Videos whose frames last for different times."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

PATH = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts")


def boxes(data: bytes, begin: int, end: int) -> Iterator[tuple[int, int, bytes]]:
    while begin < end:
        size, name = struct.unpack(">I4s", data[begin : begin + 8])
        yield begin, size, name
        begin += size


def retimed(data: bytes, durations: Sequence[float]) -> bytes:
    """An MP4 whose frames last so many times as long, in the box of durations at its end."""
    places, begin, end = [], 0, len(data)
    for wanted in PATH:
        place, size = next((p, n) for p, n, name in boxes(data, begin, end) if name == wanted)
        places.append(place)
        begin, end = place + 8, place + size
    (each,) = struct.unpack(">I", data[places[-1] + 20 : places[-1] + 24])
    rows = b"".join(struct.pack(">II", 1, round(each * d)) for d in durations)
    new = struct.pack(">I4sII", 16 + len(rows), b"stts", 0, len(durations)) + rows
    out = bytearray(data[: places[-1]] + new + data[end:])
    for place in places[:-1]:
        (size,) = struct.unpack(">I", out[place : place + 4])
        out[place : place + 4] = struct.pack(">I", size + len(new) - (end - places[-1]))
    return bytes(out)
