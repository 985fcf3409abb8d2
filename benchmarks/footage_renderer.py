"""Rendering footage with the scripts in `tools`, unless it exists already."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.errors import FootageError

ROOT = Path(__file__).resolve().parents[1]


def render(script: str, arguments: Sequence[str], *, what: str) -> None:
    """Run a script of `tools` that renders footage.

    Parameters
    ----------
    script : str
        Its file name.
    arguments : sequence of str
    what : str
        Name of the footage in errors.

    Raises
    ------
    FootageError
        It cannot be rendered.
    """
    path = ROOT / "tools" / script
    if not path.is_file():
        raise FootageError("the renderer is not installed", where=str(path), todo="run it from a checkout")
    command = [sys.executable, str(path), *arguments]
    process = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if process.returncode:
        reason = process.stderr.strip().splitlines() or ["the renderer ended without a word"]
        raise FootageError(f"it could not be rendered: {reason[-1]}", where=what)
