"""What a command prints when it is done."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ..core.errors import OutputError


def print_outcome(files: Iterable[Path], remarks: Iterable[object] = ()) -> None:
    """Print the files that were written, and remarks on standard error: the list of files can be piped on as it is.

    Raises
    ------
    OutputError
        The list cannot be written. A program that has closed its end of the pipe did not want the rest.
    """
    try:
        print(*files, sep="\n", flush=True)
    except OSError as error:
        with suppress(OSError):  # what is left would be tried again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            what = f"the list of files cannot be written, but the files have been: {error.strerror}"
            raise OutputError(what, where="standard output") from error
    for remark in remarks:
        print(f"kfmocap: {remark}", file=sys.stderr)
