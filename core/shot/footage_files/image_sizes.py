"""Image sizes as stated in files, checked before memory is allocated for the pixels."""

from __future__ import annotations

import struct

PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_PNG_PIECE = 12  # bytes of a chunk's length, type and checksum
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers of the frame headers that hold the size
_TIFF_SIDES = 256, 257  # tags of its width and height
_TIFF_TYPES = {3: "H", 4: "I", 16: "Q"}  # of whole numbers
_PIXELS_OF_A_BYTE, _SMALL = 32, 1 << 20  # in a camera's pictures, at most; bytes of a file that may state up to 8K


def image_size(data: bytes) -> tuple[int, int] | None:
    """Return the width and height stated in a PNG, JPEG, BMP, TIFF or WebP file, before rotation by its metadata.

    Parameters
    ----------
    data : bytes
        The file's content, from its beginning.

    Returns
    -------
    tuple of int, optional
        None if it is none of these formats, or ends before the size.
    """
    try:
        if data.startswith(PNG):
            width, height = struct.unpack_from(">II", data, 16)
        elif data.startswith(JPEG):
            return _jpeg_size(data)
        elif data.startswith(b"BM"):
            narrow = struct.unpack_from("<I", data, 14)[0] == 12
            width, height = struct.unpack_from("<HH" if narrow else "<ii", data, 18)
        elif data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff_size(data)
        elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
        else:
            return None
    except struct.error:
        return None
    return abs(width), abs(height)


def is_out_of_proportion(size: tuple[int, int], length: int) -> bool:
    """Whether an image states more pixels than its file of `length` bytes can hold.

    Camera pictures take at least a quarter of a bit per pixel. Files below 1 MB may state up to 8K, which takes 100 MB
    of memory.
    """
    return size[0] * size[1] > _PIXELS_OF_A_BYTE * max(length, _SMALL)


def breaks_off(data: bytes) -> bool:
    """Whether a PNG file ends before one of its chunks does: OpenCV would allocate memory for what is missing."""
    if not data.startswith(PNG):
        return False
    place = len(PNG)
    while place < len(data):
        if data[place + 4 : place + 8] == b"IEND":  # the rest is ignored
            return False
        place += int.from_bytes(data[place : place + 4], "big") + _PNG_PIECE
    return place > len(data)


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    place = len(JPEG)
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker, length = data[place + 1], int.from_bytes(data[place + 2 : place + 4], "big")
        if marker == 0xFF:  # any number of fill bytes may precede a marker
            place += 1
            continue
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return width, height
        place += 2 + length
    return None


def _tiff_size(data: bytes) -> tuple[int, int] | None:
    order = "<" if data.startswith(b"II") else ">"
    (version,) = struct.unpack_from(f"{order}H", data, 2)
    large = version == 43
    place, count, entry = ("Q", "Q", 20) if large else ("I", "H", 12)
    (directory,) = struct.unpack_from(order + place, data, 8 if large else 4)
    (entries,) = struct.unpack_from(order + count, data, directory)
    sides = {}
    for k in range(min(entries, 4096)):
        begin = directory + struct.calcsize(count) + k * entry
        tag, kind = struct.unpack_from(f"{order}HH", data, begin)
        if tag in _TIFF_SIDES and kind in _TIFF_TYPES:
            (sides[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, begin + (12 if large else 8))
    return (sides[256], sides[257]) if len(sides) == len(_TIFF_SIDES) else None


def _webp_size(data: bytes) -> tuple[int, int] | None:
    if data[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b"VP8X" and len(data) >= 30:
        return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
    return None
