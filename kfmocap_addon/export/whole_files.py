"""Checking that files written by Blender are complete: on a full disk, Blender reports success for a truncated file."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import OutputError
from ...core.runtime.output_files.files import remedy, replacing, unwritable

_BLEND, _BLEND_END = b"BLENDER", b"ENDB"
_END_LENGTHS = (20, 24, 32)  # of the last block, which is but a header: before 5.0 of 32 and of 64 bits, and since
_ZSTD, _ZSTD_END = b"\x28\xb5\x2f\xfd", b"\xb1\xea\x92\x8f"  # a compressed file, and the end of its table of frames
_FBX = b"Kaydara FBX Binary"
_FBX_END = bytes.fromhex("f85a8c6adef5d97eece90ce3758f290b")
_TAIL = 64  # bytes of an end that is looked at


def check_whole(path: Path, shown: Path | None = None) -> None:
    """Check that a .blend, .fbx, .bvh, .glb, .vrma or .usdc file is complete.

    Parameters
    ----------
    path : Path
    shown : Path, optional
        Its path for messages, where this is a temporary one.

    Raises
    ------
    OutputError
        It is missing or cut off.
    """
    checks = {
        ".blend": _is_whole_blend,
        ".fbx": _is_whole_fbx,
        ".bvh": _is_whole_bvh,
        ".glb": _is_whole_glb,
        ".vrma": _is_whole_glb,
        ".usdc": _is_whole_usd,
    }
    try:
        whole = checks[path.suffix.lower()](path)
    except (OSError, ValueError):
        whole = False
    if not whole:
        raise OutputError("Blender wrote it in part only", where=str(shown or path), todo="is the disk full?")


def _ends(path: Path, count: int) -> tuple[bytes, bytes]:
    """Return the first and the last bytes of a file."""
    with path.open("rb") as file:
        begin = file.read(count)
        file.seek(max(0, file.seek(0, 2) - _TAIL))
        return begin, file.read()


def _is_whole_blend(path: Path) -> bool:
    begin, end = _ends(path, len(_BLEND))
    if begin == _BLEND:
        marked = len(end) - end.rfind(_BLEND_END) in _END_LENGTHS
    else:
        marked = begin.startswith(_ZSTD) and end.endswith(_ZSTD_END)
    if not marked:
        return False
    opened: Any = bpy.data.libraries.load
    with opened(str(path)) as (found, _):
        return bool(found.scenes)


def _is_whole_fbx(path: Path) -> bool:
    begin, end = _ends(path, len(_FBX))
    return begin == _FBX and end.endswith(_FBX_END)


def _is_whole_glb(path: Path) -> bool:
    """Whether it is as long as its header says."""
    begin, _ = _ends(path, 12)
    return begin.startswith(b"glTF") and int.from_bytes(begin[8:12], "little") == path.stat().st_size


def _is_whole_usd(path: Path) -> bool:
    """Whether the table of contents, which is written last, lies within it."""
    begin, _ = _ends(path, 24)
    contents = int.from_bytes(begin[16:24], "little")
    return begin.startswith(b"PXR-USDC") and 0 < contents < path.stat().st_size


def _is_whole_bvh(path: Path) -> bool:
    """Whether it has as many lines of numbers, of equal length, as it says."""
    text = path.read_text(encoding="utf-8")
    count = re.search(r"^Frames:\s*(\d+)", text, re.MULTILINE)
    rows = text.partition("Frame Time:")[2].splitlines()[1:]
    channels = sum(int(number) for number in re.findall(r"CHANNELS (\d+)", text))
    return count is not None and len(rows) == int(count[1]) and all(len(row.split()) == channels for row in rows)


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Do the same as `replacing`, create the folder if necessary, and raise Blender's failures as OutputErrors,
    including those that it does not report, see `check_whole`.

    What Blender's exporters print, such as tracebacks, is suppressed.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path.parent, error, "the folder cannot be made") from error
    printed = io.StringIO()
    with replacing(path) as target, contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            yield target
        except RuntimeError as error:
            reason = _reason(error)
            number = re.search(r"\[Errno (\d+)\]", reason)
            todo = remedy(int(number[1])) if number else None
            raise OutputError(f"Blender cannot write it: {reason}", where=str(path), todo=todo) from error
        check_whole(target, path)


def _reason(error: RuntimeError) -> str:
    """Return what an operator failed with: where that was an exception in Python, Blender gives its traceback
    instead.
    """
    message = str(error).partition("\nLocation:")[0].strip()
    return message.splitlines()[-1] if "Traceback" in message else message
