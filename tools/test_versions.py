"""Run the add-on's tests on the other versions of Blender that the extension is for.

Each has an environment of its own, made on first use, with its bpy and the Python that this needs; where one of them
cannot be had, the version is left out, and that is said. The tests of the zip install it into another environment that
holds bpy alone.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLENDERS = {"4.5.15": "3.11", "5.2.3": "3.13"}
"""The Python of each bpy; the one that `make install` has is tested by `make test`."""


def find_python(version: str) -> str | None:
    """A Python of a version: on the PATH, or one of pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [f"python{version}", *map(str, sorted(pyenv.glob(f"{version}.*/bin/python")))]
    for candidate in candidates:
        try:
            found = subprocess.run([candidate, "-c", "import ensurepip"], capture_output=True, check=False)
        except OSError:
            continue
        if found.returncode == 0:
            return candidate
    return None


def environment(name: str, python: str, *packages: str) -> Path:
    """The Python of an environment beside the project with those packages, made or renewed where it has to be."""
    folder = ROOT / name
    mark = folder / ".installed"
    if not mark.exists() or mark.stat().st_mtime < (ROOT / "pyproject.toml").stat().st_mtime:
        subprocess.run([python, "-m", "venv", folder], check=True)
        # One command: resolved apart, opencv pulls in a numpy that bpy cannot use.
        subprocess.run([folder / "bin/pip", "install", "--quiet", *packages], cwd=ROOT, check=True)
        mark.touch()
    return folder / "bin/python"


def tested(blender: str, python: str) -> bool:
    """Whether the add-on's tests pass on a version of Blender, or it cannot be had."""
    short = blender.rpartition(".")[0]
    try:
        full = environment(f".venv-{short}", python, "--editable", ".[dev]", f"bpy=={blender}")
        bare = environment(f".venv-{short}-bare", python, f"bpy=={blender}")
    except subprocess.CalledProcessError as error:
        print(f"Blender {blender}: left out, it cannot be installed ({error})", flush=True)
        return True
    files = sorted((ROOT / "tests" / "addon").glob("test_*.py"))
    command = [full, "-m", "pytest", "-q", "--numprocesses", "auto", "--dist", "loadfile", *files]
    run = subprocess.run(command, cwd=ROOT, env=os.environ | {"KFMOCAP_BARE": str(bare)}, check=False)
    return run.returncode == 0


def main() -> int:
    """Test every version for which there is a Python; 1 where one fails."""
    failed = []
    for blender, version in BLENDERS.items():
        python = find_python(version)
        print(f"Blender {blender}: {python or f'left out, there is no Python {version}'}", flush=True)
        if python is not None and not tested(blender, python):
            failed.append(blender)
    if failed:
        print(f"The tests fail on Blender {', '.join(failed)}")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
