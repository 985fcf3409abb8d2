"""The display of a running batch: on a terminal, one line for every shot that is being tracked; otherwise plain
lines.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Mapping
from types import TracebackType

from .batch_outcome import ShotOutcome, ShotState

_REDRAW_SECONDS = 0.2
_STEP = 0.1
"""Step in which progress is printed without a terminal, as a fraction."""


class BatchDisplay:
    """The display of a batch of shots, on standard error.

    Parameters
    ----------
    total : int
        Number of shots.
    """

    def __init__(self, total: int) -> None:
        self._total, self._finished = total, 0
        self._live = sys.stderr.isatty()
        self._drawn, self._last = 0, 0.0
        self._printed_steps: dict[str, int] = {}

    def __enter__(self) -> BatchDisplay:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._clear()

    def started(self, name: str, process_id: int) -> None:
        """Show that a shot is being tracked."""
        self._printed_steps[name] = 0
        if not self._live:
            self.print_line(f"{name}: started, process {process_id}")

    def skipped(self, outcome: ShotOutcome) -> None:
        """Show that a shot was done before."""
        self._finished += 1
        self.print_line(f"[{self._finished}/{self._total}] {outcome.name}: was done before")

    def finished(self, outcome: ShotOutcome) -> None:
        """Show that a shot is done, or has failed."""
        self._finished += 1
        details = outcome.message
        if outcome.state == ShotState.DONE:
            error = "" if outcome.expected_error is None else f", expected error {outcome.expected_error:.0f} mm"
            details = f"{outcome.seconds or 0:.0f} s{error}"
        self.print_line(f"[{self._finished}/{self._total}] {outcome.name}: {outcome.state}, {details}")

    def print_line(self, line: str) -> None:
        """Print a line that stays."""
        self._clear()
        print(f"kfmocap: {line}", file=sys.stderr, flush=True)

    def update(self, states: Mapping[str, tuple[str, float]]) -> None:
        """Show the stage of each running shot, and the fraction that is done."""
        if not self._live:
            for name, (what, fraction) in states.items():
                step = int(fraction / _STEP)
                if step > self._printed_steps.get(name, 0):
                    self._printed_steps[name] = step
                    self.print_line(f"{name}: {what} {fraction:.0%}")
            return
        now = time.monotonic()
        if now - self._last < _REDRAW_SECONDS:
            return
        self._last = now
        width = shutil.get_terminal_size().columns
        lines = [f"{self._finished} of {self._total} shots"]
        lines += [f"  {name[:20]:20} {what[:18]:18} {fraction:4.0%}" for name, (what, fraction) in states.items()]
        self._clear()
        print("\n".join(line[: width - 1] for line in lines), file=sys.stderr, flush=True)
        self._drawn = len(lines)

    def _clear(self) -> None:
        """Erase the lines that are drawn again."""
        if self._drawn:
            print(f"\x1b[{self._drawn}F\x1b[J", end="", file=sys.stderr, flush=True)
            self._drawn = 0
