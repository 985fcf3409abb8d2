"""The worker's end of `worker_process.WorkerProcess`: a script that does one task after another in its own process.

Tasks arrive, and results are sent, as pickles.
"""

import _thread
import importlib
import importlib.util
import os
import pickle
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType

NICENESS = 5
"""Niceness of the process on systems that have it, so that the waiting program comes first."""
GRACE_SECONDS = 0.6
"""Seconds that a task has to clean up after the program has ended. Its own worker processes have nothing to clean up
and end with it, so that no process is left two seconds after the program has ended."""
LENGTH_BYTES = 8
"""Size of the length, little-endian, that precedes every message to this process, bytes."""


def main() -> None:
    """Read tasks from standard input until it is closed; write progress and results to standard output."""
    outgoing = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not get into the protocol
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; the program decides
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sent: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    tidying = threading.Event()
    threading.Thread(target=_receive, args=(sent, tidying), daemon=True).start()

    lock = threading.Lock()

    def send(*message: object) -> bool:
        data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
        with lock:
            outgoing.write(data)
            outgoing.flush()
        return True

    try:
        if (head := sent.get()) is None:
            return
        kept, tidies = _prepare(head)
        memory = kept.WorkerMemory()
        while (data := sent.get()) is not None:
            if tidies:
                tidying.set()
            _answer(data, kept, memory, send)
            tidying.clear()
    except (BrokenPipeError, KeyboardInterrupt):
        os._exit(1)  # the program has ended
    except Exception as error:
        error.add_note(traceback.format_exc())
        send("error", error)


def _prepare(head: bytes) -> tuple[ModuleType, bool]:
    """Load the package and the modules that the first message names; returns the module `worker_memory`, and whether
    tasks have to clean up when the program ends.
    """
    search, package, folder, yields, tidies, imports = pickle.loads(head)
    if yields and hasattr(os, "nice"):
        os.nice(NICENESS)
    sys.path[:] = search
    if package not in sys.modules:
        load(package, Path(folder))
    with importlib.import_module(f"{package}.core.runtime.loading").without_garbage_collection():
        for module in imports:
            importlib.import_module(module)
    return importlib.import_module(f"{package}.core.runtime.processes.worker_memory"), tidies


def _answer(data: bytes, kept: ModuleType, memory: object, send: Callable[..., bool]) -> None:
    """Do a task, and send its progress, then its result or the error that it raised; `kept` is `worker_memory`."""
    try:
        work = pickle.loads(data)
        if isinstance(work, kept.CachingTask):
            shown = {"show": lambda key, value: send("shown", (key, value))} if work.shows else {}
            work = partial(work.work, memory=memory, **shown)
        result = work(lambda what, fraction: send("progress", (what, fraction)))
    except BrokenPipeError:
        raise
    except Exception as error:
        error.add_note(traceback.format_exc())
        send("error", error)
    else:
        send("result", result)


def _receive(sent: "queue.SimpleQueue[bytes | None]", tidying: threading.Event) -> None:
    """Pass on messages, and end this process when the program has ended, which closes its end of the pipe.

    The process ends at once, unless the current task has to clean up.
    """
    while (length := _read(LENGTH_BYTES)) and (data := _read(int.from_bytes(length, "little"))):
        sent.put(data)
    if tidying.is_set():
        sent.put(None)
        _thread.interrupt_main(signal.SIGTERM)
        time.sleep(GRACE_SECONDS)
    os._exit(1)


def _read(count: int) -> bytes:
    """Read `count` bytes from standard input; empty if it is closed."""
    pieces = []
    while count > 0:
        try:
            piece = os.read(0, count)  # not through sys.stdin, whose lock would be held when Python ends
        except OSError:
            piece = b""
        if not piece:
            return b""
        pieces.append(piece)
        count -= len(piece)
    return b"".join(pieces)


def load(package: str, folder: Path) -> None:
    """Import a package under the name that it has in the program, without the packages that contain it there."""
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
