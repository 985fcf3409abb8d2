"""What a command prints when it is done."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path


def print_outcome(files: Iterable[Path], remarks: Iterable[object] = ()) -> None:
    """Print the files that were written, and remarks on standard error: the list of files can be piped on as it is."""
    print(*files, sep="\n")
    for remark in remarks:
        print(f"kfmocap: {remark}", file=sys.stderr)
