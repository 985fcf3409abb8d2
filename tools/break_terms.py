"""Break each term of the papers in a copy of the program, and see that the test fails that watches over it.

    .venv/bin/python tools/break_terms.py [--only "(27)"]

The terms are those of docs/papers.md. The exit code is 1 if a broken term is not noticed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from papers import TERMS
from papers.term import Term

ROOT = Path(__file__).resolve().parents[1]


def broken_copy(term: Term, folder: Path) -> None:
    """Copy the files that git knows of, and break a term in the copy."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        target = folder / "kfmocap" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file() and (not name.startswith("docs/") or name.endswith(".md")):
            shutil.copy(ROOT / name, target)
    file = folder / "kfmocap" / term.file
    file.write_text(file.read_text(encoding="utf-8").replace(term.right, term.wrong), encoding="utf-8")


def is_noticed(term: Term) -> bool:
    """Whether the test of a term fails when the term is broken."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        broken_copy(term, folder)
        environment = os.environ | {"PYTHONPATH": str(folder)}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", term.test]
        ran = subprocess.run(
            command, cwd=folder / "kfmocap", env=environment, capture_output=True, text=True, check=False
        )
        return ran.returncode == 1 and f"FAILED {term.test}" in ran.stdout


def main(argv: Sequence[str] | None = None) -> int:
    """Break the terms one after the other; returns the exit code."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--only", default="", metavar="TEXT", help="terms whose names contain this")
    chosen = [term for term in TERMS if arguments.parse_args(argv).only in term.item]
    missed = 0
    for term in chosen:
        noticed = is_noticed(term)
        missed += not noticed
        print(f"{'noticed' if noticed else 'NOT NOTICED':12}{term.item:24}{term.test.rpartition('::')[2]}", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} broken terms are noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
