"""An environment that holds Blender and what its wheel requires, and nothing of ours, without installing anything."""

from __future__ import annotations

import os
import re
import venv
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path


def required(name: str) -> dict[str, Distribution]:
    """Find a distribution and all that it requires in this environment, extras left out."""
    found: dict[str, Distribution] = {}
    waiting = [name]
    while waiting:
        name = re.sub("[-_.]+", "-", waiting.pop()).lower()
        try:
            found.setdefault(name, distribution(name))
        except PackageNotFoundError:
            continue  # it is for other systems or other versions of Python
        wanted = [r for r in found[name].requires or [] if "extra ==" not in r]
        names = [re.sub("[-_.]+", "-", re.match("[A-Za-z0-9._-]+", r)[0]).lower() for r in wanted]
        waiting += [n for n in names if n not in found]
    return found


def make_bare_environment(folder: Path) -> Path:
    """Make a virtual environment that shares this one's Blender; return its Python."""
    venv.create(folder, symlinks=os.name != "nt", with_pip=False)
    [packages] = [path for path in folder.rglob("site-packages") if path.is_dir()]
    for found in required("bpy").values():
        for top in {file.parts[0] for file in found.files or [] if not file.parts[0].startswith((".", "_"))}:
            (packages / top).symlink_to(found.locate_file(top))
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
