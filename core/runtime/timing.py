"""Timing of the stages of a job."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class Seconds(dict[str, float]):
    """Seconds by stage, added up."""

    def add(self, more: Mapping[str, float]) -> None:
        """Add the seconds of another job's stages."""
        for stage, seconds in more.items():
            self[stage] = self.get(stage, 0.0) + seconds

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time that the block takes to a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.add({stage: time.perf_counter() - begin})
