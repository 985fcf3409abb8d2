"""The final output of a command."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ..core.errors import OutputError


def print_outcome(files: Iterable[Path], remarks: Iterable[object] = ()) -> None:
    """Print the files that were written, and remarks on standard error, so that the list of files can be piped.

    Raises
    ------
    OutputError
        The list cannot be written; not raised if the reader has closed its end of a pipe.
    """
    try:
        print(*files, sep="\n", flush=True)
    except OSError as error:
        with suppress(OSError):  # the rest would otherwise be written, and fail again, at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            what = f"the list of files cannot be written, but the files have been: {error.strerror}"
            raise OutputError(what, where="standard output") from error
    for remark in remarks:
        print(f"kfmocap: {remark}", file=sys.stderr)
