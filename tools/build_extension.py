"""Build the extension, one zip per platform, with Blender's own builder and wheels pinned by hash.

    python tools/build_extension.py                          every platform, into dist/
    python tools/build_extension.py --platform linux-x64     one of them
    python tools/build_extension.py --update-lock            after a version in pyproject.toml has changed

Wheels come from the package registry through pip and stay in wheels/. Each must have the SHA-256 that
tools/wheels.lock records for it.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import platform as host
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CACHE = ROOT / "wheels"
LOCK = ROOT / "tools" / "wheels.lock"
MANIFEST = "blender_manifest.toml"

# What pip calls the platforms. Blender 4.5 and 5.0 run Python 3.11, from 5.1 on Python 3.13.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_13_0_arm64",),
    "macos-x64": ("macosx_13_0_x86_64",),
}
PYTHONS = ("3.11", "3.13")
IN_BLENDER = "numpy"


class BuildError(Exception):
    """The extension cannot be built; the message says why."""


def requirements() -> list[str]:
    """Return what the extension bundles: the package's dependencies but for what Blender brings."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [line for line in project["dependencies"] if not line.startswith(IN_BLENDER)]


def read_lock() -> dict[str, str]:
    """SHA-256 by wheel file name."""
    return tomllib.loads(LOCK.read_text())["sha256"]


def platform_of(wheel: str) -> str | None:
    """Blender's name for the platform of a wheel file, None if it runs everywhere."""
    tag = wheel.removesuffix(".whl").split("-")[-1]
    for platform, names in PLATFORMS.items():
        system, machine = re.match(r"([a-z]+).*?_(arm64|x86_64|amd64)$", names[0]).groups()
        if tag.startswith(system) and tag.endswith(machine):
            return platform
    return None


def download(platform: str, python: str, folder: Path) -> None:
    """Fetch the wheels for one platform and Python into a folder; those already there stay."""
    names = [option for tag in PLATFORMS[platform] for option in ("--platform", tag)]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
    command += ["--python-version", python, *names, "--dest", str(folder), *requirements()]
    if subprocess.run(command, check=False).returncode:
        raise BuildError(f"pip could not download the wheels for {platform}, Python {python}")


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fetch(platform: str) -> list[str]:
    """File names of the platform's locked wheels, all of them in the cache and verified."""
    lock = {name: digest for name, digest in read_lock().items() if platform_of(name) in (platform, None)}
    if not all((CACHE / name).exists() for name in lock):
        for python in PYTHONS:
            download(platform, python, CACHE)
    for name, digest in lock.items():
        path = CACHE / name
        if not path.exists():
            raise BuildError(f"{name} is in {LOCK.name}, but the registry offers another file: --update-lock?")
        if sha256(path) != digest:
            raise BuildError(f"{path} does not have the SHA-256 in {LOCK.name}; delete it and try again")
    return list(lock)


def fetch_unlocked(platform: str, python: str) -> list[str]:
    """File names of wheels for a Python that no official Blender has, for tests only."""
    with tempfile.TemporaryDirectory() as folder:
        download(platform, python, Path(folder))
        wheels = [path.name for path in Path(folder).iterdir()]
        for name in wheels:
            shutil.copy(Path(folder, name), CACHE / name)
    return wheels


def update_lock() -> None:
    """Download every wheel anew; write their hashes to the lock and their names to the manifest."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for platform in PLATFORMS:
            for python in PYTHONS:
                download(platform, python, folder)
        wheels = sorted(folder.iterdir())
        lines = "".join(f'"{path.name}" = "{sha256(path)}"\n' for path in wheels)
        CACHE.mkdir(exist_ok=True)
        for path in wheels:
            shutil.copy(path, CACHE / path.name)
    LOCK.write_text("# Written by `python tools/build_extension.py --update-lock`.\n[sha256]\n" + lines)
    manifest = ROOT / MANIFEST
    manifest.write_text(with_list(manifest.read_text(), "wheels", [f"./wheels/{path.name}" for path in wheels]))


def with_list(toml: str, key: str, values: Iterable[str]) -> str:
    """Return the same TOML text with another list of strings under a top-level key."""
    items = "".join(f"    {json.dumps(value)},\n" for value in values)
    return re.sub(rf"^{key} = \[[^\]]*\]", f"{key} = [\n{items}]", toml, count=1, flags=re.MULTILINE)


def stage(folder: Path, platforms: Iterable[str], wheels: Iterable[str]) -> None:
    """Lay out in a folder what the builder is to see: a manifest for these platforms alone, and the sources.

    The builder would otherwise want the wheels of every platform in the manifest.
    """
    toml = (ROOT / MANIFEST).read_text()
    excluded = tomllib.loads(toml)["build"]["paths_exclude_pattern"]
    at_root = shutil.ignore_patterns(*(pattern.strip("/") for pattern in excluded))
    below = shutil.ignore_patterns(*(pattern.strip("/") for pattern in excluded if pattern[0] != "/"))
    shutil.copytree(ROOT, folder, ignore=lambda path, names: (at_root if Path(path) == ROOT else below)(path, names))
    (folder / "wheels").symlink_to(CACHE)
    toml = with_list(toml, "platforms", platforms)
    toml = with_list(toml, "wheels", [f"./wheels/{name}" for name in wheels])
    (folder / MANIFEST).write_text(toml)


def blender_builder(*arguments: str) -> None:
    """Run the builder that comes inside bpy; it needs no Blender."""
    spec = importlib.util.find_spec("bpy")
    if spec is None:
        raise BuildError("bpy is not installed: run `make install` and use .venv/bin/python")
    builder = next(Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if subprocess.run([sys.executable, str(builder), *arguments], check=False).returncode:
        raise BuildError(f"Blender's builder refused: {' '.join(arguments)}")


def this_platform() -> str:
    """Name this machine's platform as Blender does."""
    system = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}[host.system()]
    return f"{system}-{'arm64' if host.machine() in ('arm64', 'aarch64') else 'x64'}"


def build(platforms: Iterable[str], output: Path, more_pythons: Iterable[str] = ()) -> list[Path]:
    """Build and validate one zip per platform; their paths."""
    platforms = list(platforms)
    wheels = {name for platform in platforms for name in fetch(platform)}
    wheels |= {name for p in platforms for python in more_pythons for name in fetch_unlocked(p, python)}
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        source, built = Path(temporary, "source"), Path(temporary, "built")
        built.mkdir()
        stage(source, platforms, sorted(wheels))
        blender_builder("build", "--split-platforms", "--source-dir", str(source), "--output-dir", str(built))
        for path in sorted(built.glob("*.zip")):
            blender_builder("validate", str(path))
        return [Path(shutil.move(path, output / path.name)) for path in sorted(built.glob("*.zip"))]


def main() -> int:
    """Build the zips, or renew the lock; 1 after an error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--platform", choices=PLATFORMS, help="build for this platform only")
    parser.add_argument("--python", action="append", default=[], help="for tests: wheels for this Python too")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder of the zips (dist)")
    parser.add_argument("--fetch", action="store_true", help="download this machine's wheels, build nothing")
    parser.add_argument("--update-lock", action="store_true", help="renew the lock and the manifest's wheels")
    arguments = parser.parse_args()
    try:
        if arguments.update_lock:
            update_lock()
            return 0
        if arguments.fetch:
            fetch(this_platform())
            return 0
        platforms = [arguments.platform] if arguments.platform else list(PLATFORMS)
        for path in build(platforms, arguments.output, arguments.python):
            print(f"{path}  {path.stat().st_size / 1e6:.0f} MB")
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
