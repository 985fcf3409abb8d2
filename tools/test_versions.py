"""Run what depends on the version of Blender on the other versions that the extension is for.

Each has an environment of its own, made on first use, with its bpy and the Python that this needs; where one of them
cannot be had, the version is left out, and that is said.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLENDERS = {"4.5.15": "3.11", "5.2.3": "3.13"}
"""The Python of each bpy; the one that `make install` has is tested by `make test`."""
LEFT_OUT = ("calibration", "posing", "refine", "review", "simplification")
"""Parts of the add-on whose tests are mostly about the core: with other versions, only the tests of all operators (any
call, undo) and of the installed extension cover them."""


def find_python(version: str) -> str | None:
    """Return a Python of a version: on the PATH, or one of pyenv's."""
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


def environment(blender: str, python: str) -> Path:
    """Return the Python of a version's environment beside the project, made or renewed where it has to be."""
    folder = ROOT / f".venv-{blender.rpartition('.')[0]}"
    mark = folder / ".installed"
    if not mark.exists() or mark.stat().st_mtime < (ROOT / "pyproject.toml").stat().st_mtime:
        subprocess.run([python, "-m", "venv", folder], check=True)
        # One command: resolved apart, opencv pulls in a numpy that bpy cannot use.
        packages = ["--editable", ".[test]", f"bpy=={blender}"]
        subprocess.run([folder / "bin/pip", "install", "--quiet", *packages], cwd=ROOT, check=True)
        mark.touch()
    return folder / "bin/python"


def environments() -> dict[str, Path]:
    """Return the Python of each version that can be had; says of the others why not."""
    found = {}
    for blender, version in BLENDERS.items():
        python = find_python(version)
        if python is None:
            print(f"Blender {blender}: left out, there is no Python {version}", flush=True)
            continue
        try:
            found[blender] = environment(blender, python)
        except subprocess.CalledProcessError as error:
            print(f"Blender {blender}: left out, it cannot be installed ({error})", flush=True)
    return found


def passes(blender: str, python: Path) -> bool:
    """Whether the tests pass on a version of Blender."""
    print(f"Blender {blender}:", flush=True)
    files = sorted((ROOT / "tests" / "addon").rglob("test_*.py"))
    files = [file for file in files if not file.stem.endswith(LEFT_OUT)]
    command = [python, "-m", "pytest", "-q", "--numprocesses", "auto", "--dist", "worksteal", "--durations", "5"]
    return subprocess.run([*command, *files], cwd=ROOT, check=False).returncode == 0


def main() -> int:
    """Test every version that can be had; 1 where one fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--install", action="store_true", help="make the environments and test nothing")
    install = parser.parse_args().install
    found = environments()
    failed = [] if install else [blender for blender, python in found.items() if not passes(blender, python)]
    if failed:
        print(f"The tests fail on Blender {', '.join(failed)}")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
