"""Folders of shots of characters with their rigs: footage, calibration.toml and rig.blend. Needs no Blender."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats import save_cameras
from numpy.typing import NDArray

JPEG_QUALITY = 90


def digest(name: str, script: Path, modules: Sequence[str]) -> str:
    """Hash of everything that a character's files depend on: its name, a script, and modules beside this one."""
    sources = [script, *(Path(__file__).with_name(f"{module}.py") for module in ("rig_folders", *modules))]
    return hashlib.sha256(b"".join([*(source.read_bytes() for source in sources), name.encode()])).hexdigest()[:16]


def write_folder(folder: Path, mark: str, write: Callable[[Path], None]) -> None:
    """Write a folder as a whole, unless one that was written with the same mark is there.

    Parameters
    ----------
    folder : Path
    mark : str
        See `digest`.
    write : callable
        Writes the files into another folder, which becomes this one.
    """
    folder = folder.resolve()  # Blender's relative paths need whole ones
    if (folder / "digest.txt").is_file() and (folder / "digest.txt").read_text() == mark:
        return
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as scratch:
        part = Path(scratch) / folder.name
        part.mkdir()
        write(part)
        (part / "digest.txt").write_text(mark)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(part, folder)


def write_footage(
    folder: Path, cameras: Sequence[Camera], pictures: Iterable[tuple[int, int, NDArray[np.uint8]]]
) -> None:
    """Write the calibration, and pictures (the view's number, the frame, and the picture) into a folder per view."""
    save_cameras(folder / "calibration.toml", {camera.name: camera for camera in cameras})
    for camera in cameras:
        (folder / camera.name).mkdir()
    for v, frame, image in pictures:
        path = folder / cameras[v].name / f"{frame:04d}.jpg"
        if not cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
            raise OSError(f"{path} cannot be written")
