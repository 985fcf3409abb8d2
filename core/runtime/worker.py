"""The other end of `job.Job`: a process of its own that does one piece of work and reports how far it is.

It is run as a script. What comes in and goes out are pickles; see `job.Job`.
"""

import _thread
import contextlib
import importlib.util
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from types import ModuleType

NICENESS = 5
"""Where that is known, the program that is waiting goes first."""
GRACE = 1.0
"""Seconds that the work has to tidy up when nobody waits for it any more."""


def main() -> None:
    """Read the work from standard input, do it, and write its progress and result to standard output."""
    incoming, outgoing = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is not part of the protocol
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal: one of them decides
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if hasattr(os, "nice"):
        os.nice(NICENESS)

    def tell(*message: object) -> bool:
        outgoing.write(pickle.dumps(message))
        outgoing.flush()
        return True

    try:
        search, package, folder = pickle.load(incoming)
        sys.path[:] = search
        load(package, Path(folder))
        work, done = pickle.load(incoming), threading.Event()
        threading.Thread(target=_end_with_parent, args=(done,), daemon=True).start()
        result = work(lambda what, fraction: tell("progress", (what, fraction)))
        done.set()
        tell("result", result)
    except (BrokenPipeError, KeyboardInterrupt):
        os._exit(1)  # nobody listens any more
    except Exception as error:
        error.add_note(traceback.format_exc())
        tell("error", error)


def _end_with_parent(done: threading.Event) -> None:
    """End this process when the program that waits for it has ended: its end of the pipe was closed with it."""
    with contextlib.suppress(OSError):
        os.read(0, 1)  # not through sys.stdin, whose lock would be held when Python ends
    if done.is_set():
        return
    _thread.interrupt_main(signal.SIGTERM)  # to tidy up
    time.sleep(GRACE)
    os._exit(1)


def load(package: str, folder: Path) -> None:
    """Import a package by the name that it has in the program, whatever the packages around it are there."""
    parents = package.split(".")[:-1]
    for depth in range(1, len(parents) + 1):
        parent = ModuleType(".".join(parents[:depth]))
        parent.__path__ = []
        sys.modules[parent.__name__] = parent
    spec = importlib.util.spec_from_file_location(
        package, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[package] = module
    spec.loader.exec_module(module)


if __name__ == "__main__":
    main()
