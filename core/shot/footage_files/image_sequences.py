"""Image sequences: the patterns of files, the files that match a pattern, and whether they can be used as footage."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import FootageError, listed
from .image_sizes import JPEG, PNG, breaks_off, image_size, is_out_of_proportion

Image = NDArray[Any]

IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
_FILM_SUFFIXES = {".exr", ".dpx", ".cin"}  # images of film and rendering, which must be converted
PATTERNS = "a video, or a pattern of images such as frame_%04d.png, frame_####.png or frame_*.png"
_FRAME_NUMBER = re.compile(r"\d+(?=\D*$)")  # in a name without suffix: its last number
_MAX_NAME_BYTES = 255  # of a file, in bytes, on the file systems in use
_MAX_DIGITS = 18  # of a frame number
_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
_ENDS = {PNG: _PNG_END, JPEG: b"\xff\xd9"}
_MAX_SHOWN_GAPS = _SHOWN_SEQUENCES = 5


def image_files(path: Path) -> dict[int, Path] | None:
    """Return the files of an image sequence by frame from 0, or None if the path is a video's.

    A sequence is named by a pattern in the file name: printf's %04d or ####, where the lowest number is frame 0, or a
    glob with *, whose files are taken in natural order. A single image is a sequence of one frame.

    Raises
    ------
    FootageError
        No file matches the pattern, or the name is not a valid file name.
    """
    if "\0" in str(path) or len(path.name.encode(errors="replace")) > _MAX_NAME_BYTES:
        shown = f"{str(path)[:60]!r}"
        raise FootageError("no file can have this name", where=shown, todo=f"name {PATTERNS}")
    if _is_file(path):
        return {0: path} if path.suffix.lower() in IMAGE_SUFFIXES | _FILM_SUFFIXES else None
    number = re.search(r"%0?(\d*)d|#+", path.name)
    if number is None and "*" not in path.name:
        return None
    files = _numbered(path, number) if number is not None else _globbed(path)
    if not files:
        raise FootageError("no image fits this pattern", where=str(path), todo=_other_pattern(path))
    return files


def named_footage(path: Path) -> Path:
    """Return the footage that a path names: the path itself or, if it is a folder with the images of one sequence,
    their pattern.

    Raises
    ------
    FootageError
        It is a folder with something else; says what to name instead.
    """
    try:
        if not path.is_dir():
            return path
    except OSError:  # a name that is too long, or a folder around it that may not be entered: whoever reads it says so
        return path
    patterns = _patterns_in(path, IMAGE_SUFFIXES) or _patterns_in(path, _FILM_SUFFIXES)
    if len(patterns) == 1:
        return path / patterns[0]
    if not patterns:
        raise FootageError("this is a folder, and has no images in it", where=str(path), todo=f"name {PATTERNS}")
    what = f"this is a folder with several image sequences: {listed(patterns, _SHOWN_SEQUENCES)}"
    raise FootageError(what, where=str(path), todo=f"name one of them, as {path.name}/{patterns[0]}")


def _other_pattern(path: Path) -> str:
    """Return what to name instead of a pattern that no image fits."""
    found = _patterns_in(path.parent, IMAGE_SUFFIXES | _FILM_SUFFIXES)
    return f"in its folder are {listed(found, _SHOWN_SEQUENCES)}" if found else "there are no images in its folder"


def _patterns_in(folder: Path, suffixes: Collection[str]) -> list[str]:
    """Return a pattern for each sequence of numbered images in a folder, such as a_####.png, and the other images,
    by the endings of their names.
    """
    digits: dict[tuple[str, str], int] = {}
    for file in _listed(folder):
        if file.suffix.lower() in suffixes and not file.name.startswith("."):
            number = _FRAME_NUMBER.search(file.stem)
            around = (file.name, "") if number is None else (file.stem[: number.start()], file.name[number.end() :])
            digits[around] = min(digits.get(around, _MAX_DIGITS), 0 if number is None else len(number[0]))
    return sorted(before + "#" * count + after for (before, after), count in digits.items())


def footage_of(files: Iterable[Path]) -> list[Path]:
    """Return the footage among chosen files, sorted by name: videos, and one pattern per sequence of numbered images.

    Numbers without leading zeros, as in a_99.png and a_100.png, are those of one sequence, however many digits they
    have; so are those that outgrow their zeros, as in a_0099.png and a_10000.png. See `image_files` for patterns.
    """
    found: dict[Path, None] = {}
    chosen = sorted(files)
    numbers = _numbers_of({*chosen, *(file for folder in {file.parent for file in chosen} for file in _listed(folder))})
    for file in chosen:
        number = _FRAME_NUMBER.search(file.stem) if file.suffix.lower() in IMAGE_SUFFIXES else None
        if number is None:
            found[file] = None
        else:
            before, after = file.stem[: number.start()], file.name[number.end() :]
            own = numbers[file.parent, before, after]
            found[file.with_name(before + "#" * _fewest_digits(number[0], own) + after)] = None
    return list(found)


def _fewest_digits(number: str, others: Collection[str]) -> int:
    """Return how many digits the numbers of an image's sequence have at least, from all numbers in such names."""
    padded = {len(other) for other in others if other.startswith("0") and len(other) > 1}
    own = len(number) if padded else min(map(len, others))
    return max((digits for digits in padded if digits <= len(number)), default=own)


def _numbers_of(files: Iterable[Path]) -> dict[tuple[Path, str, str], set[str]]:
    """Return the numbers in the names of images, by folder and what is before and after the number."""
    numbers: dict[tuple[Path, str, str], set[str]] = {}
    for file in files:
        number = _FRAME_NUMBER.search(file.stem)
        if number is not None and file.suffix.lower() in IMAGE_SUFFIXES:
            key = file.parent, file.stem[: number.start()], file.name[number.end() :]
            numbers.setdefault(key, set()).add(number[0])
    return numbers


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError as error:
        raise FootageError(f"the footage cannot be read: {error.strerror}", where=str(path)) from error


def _numbered(path: Path, number: re.Match[str]) -> dict[int, Path]:
    """Return the files by the number in place of printf's %04d or of ####."""
    digits = int(number[1] or 1) if number[0].startswith("%") else len(number[0])
    if digits > _MAX_DIGITS:
        raise FootageError(f"a number of {digits} digits is too long", where=str(path), todo=f"name {PATTERNS}")
    before, after = re.escape(path.name[: number.start()]), re.escape(path.name[number.end() :])
    regex = re.compile(f"{before}(\\d{{{digits},{_MAX_DIGITS}}}){after}")
    hits = [(int(hit[1]), file) for file in _listed(path.parent) if (hit := regex.fullmatch(file.name))]
    lowest = min((n for n, _ in hits), default=0)
    return {n - lowest: file for n, file in hits}


def _globbed(path: Path) -> dict[int, Path]:
    """Return the files whose names match a pattern with asterisks, in natural order."""
    # Compiled by fnmatch: a plain .* for every asterisk takes exponential time.
    regex = re.compile(fnmatch.translate(re.sub(r"([?[])", r"[\1]", path.name)))
    return dict(enumerate(sorted((file for file in _listed(path.parent) if regex.match(file.name)), key=_natural)))


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise FootageError(f"the folder cannot be read: {error.strerror}", where=str(folder)) from error


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts frame2 before frame10."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", path.name)]


def read_image(path: Path) -> Image:
    """Read an image in colour; unlike `cv2.imread`, also with file names that it cannot open on Windows.

    Raises
    ------
    FootageError
        It cannot be read, or states a size that its file is too short for.
    """
    try:
        data = path.read_bytes()
        claimed = image_size(data)
        if claimed is not None and is_out_of_proportion(claimed, len(data)):
            what = f"the image is too large for a file of {len(data)} bytes: {claimed[0]}x{claimed[1]}"
            raise FootageError(what, where=str(path), todo="write it again")
        whole = claimed is not None and not breaks_off(data)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if whole else None
    except (OSError, cv2.error):
        image = None
    if image is None:
        known = ", ".join(sorted(suffix[1:] for suffix in IMAGE_SUFFIXES))
        todo = f"write it again, or convert the sequence to one of {known} with 8 bits a channel"
        what, kind = "the image cannot be read", path.suffix.lower()
        if kind in _FILM_SUFFIXES:
            what = f"{kind[1:].upper()} images cannot be read"
            todo = f"convert the sequence, as with: {_converted(path)}"
        raise FootageError(what, where=str(path), todo=todo)
    return np.asarray(image)


def _converted(path: Path) -> str:
    """Return the command that converts a sequence of images to PNG; linear ones, EXR, become brighter as for a screen.

    It is not left to OpenCV: a damaged EXR of 10 kB takes its decoder 20 seconds and gigabytes, or makes it crash.
    """
    number, pattern, start = _FRAME_NUMBER.search(path.stem), path.stem, ""
    if number is not None:
        pattern = f"{pattern[: number.start()]}%0{len(number[0])}d{pattern[number.end() :]}"
        start = f"-start_number {int(number[0])} "
    curve = ":".join(f"{channel}=gammaval(0.45)" for channel in "rgb")
    brighter = f'-vf "format=rgb48,lutrgb={curve}" ' if path.suffix.lower() == ".exr" else ""
    return f"ffmpeg {start}-i {pattern}{path.suffix} {brighter}-pix_fmt rgb24 {start}{pattern}.png"


def check_images(path: Path, files: Mapping[int, Path], frames: range, size: tuple[int, int]) -> None:
    """Check that a sequence has all images of some frames, complete and of one size, without decoding them all.

    Parameters
    ----------
    path : Path
        The pattern, for messages.
    files : mapping of int to Path
        As `image_files` gives them.
    frames : range
        Consecutive frames that are needed.
    size : tuple of int
        Width and height of the first image of the sequence, pixels.

    Raises
    ------
    FootageError
        An image is missing, cut off, unreadable, or of another size than the first.
    """
    needed = sorted(number for number in files if number in frames)
    if gaps := _gaps(needed, frames):
        what = f"images are missing in the sequence: frames {listed(gaps, _MAX_SHOWN_GAPS)}, counted from 0"
        before = [number for number in files if number < next(n for n in frames if n not in files)]
        what += f", the first of them after {files[max(before)].name}" if before else ""
        todo = (
            "write or copy these images again, or track frames without them; if the camera lost them, name the images "
            f"as *{path.suffix}, which are taken one after the other, and list the gaps as missing in the [[view]]"
        )
        raise FootageError(what, where=str(path), todo=todo)
    first = _stored_size(files[min(files)])
    for number in needed:
        stored = _stored_size(files[number])
        if stored is None or stored != first:  # only what looks unusual is decoded
            check_size(files[number], read_image(files[number]), size)


def check_size(path: Path, image: Image, size: tuple[int, int]) -> None:
    """Check that an image has the width and height of its sequence.

    Raises
    ------
    FootageError
        It has another size.
    """
    height, width = image.shape[:2]
    if (width, height) != size:
        what = f"the image is {width}x{height}, not {size[0]}x{size[1]}"
        raise FootageError(what, where=str(path), todo="write it again at the size of the sequence's first image")


def _gaps(present: Iterable[int], wanted: range) -> list[str]:
    """Return the intervals of wanted numbers that are missing among the present ones, which are increasing."""
    gaps, following = [], wanted.start
    for number in (*present, wanted.stop):
        if number > following:
            gaps.append(f"{following}" if number == following + 1 else f"{following}-{number - 1}")
        following = number + 1
    return gaps


def _stored_size(path: Path) -> tuple[int, int] | None:
    """Return width and height from the header of a PNG or JPEG file that ends as it should; None if that is unclear."""
    try:
        with path.open("rb") as file:
            head = file.read(1 << 16)
            file.seek(max(len(head) - len(_PNG_END), file.seek(0, 2) - len(_PNG_END)))
            tail = file.read()
    except OSError:
        return None
    whole = any(head.startswith(kind) and tail.endswith(end) for kind, end in _ENDS.items())
    return image_size(head) if whole else None
