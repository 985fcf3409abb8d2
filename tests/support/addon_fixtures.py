"""Fixtures of the tests of the add-on, which load them by `pytest_plugins`: Blender, and a stand-in for the tracker."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import bpy
import pytest
from addon_shots import FIRST, FRAMES, motion, track_result
from kfmocap import kfmocap_addon
from kfmocap.core.fitting import shot_cameras
from kfmocap.core.runtime.progress import Progress, report_progress
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking import retracking
from kfmocap.core.tracking.track_state import Around
from kfmocap.kfmocap_addon.properties.section_properties import sections_of


@pytest.fixture
def blender() -> Iterator[SimpleNamespace]:
    """An empty file in Blender with the add-on registered."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    kfmocap_addon.register()
    for own in ("shown", "step"):  # the window manager, and with it the open sections, outlives files
        sections_of(bpy.context).property_unset(own)
    yield bpy
    kfmocap_addon.unregister()


@pytest.fixture
def tracker(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands in for the tracker: gives the true motion of every performer, or the error that a test sets instead.

    Its cameras fit: they are not compared with footage that shows nothing.
    """
    stand_in = SimpleNamespace(
        shots=[], error=None, footage_offset=0.0, frames=FRAMES, torn=(), late=(), gaps=(), rates=(), turns=()
    )

    def track(
        given: Shot, progress: Progress | None = None, around: Around = (None, None), **_more: object
    ) -> SimpleNamespace:
        stand_in.shots.append(given)
        stand_in.around = around
        report_progress(progress, "tracking", 0.5)
        if stand_in.error is not None:
            raise stand_in.error
        first = max(given.frames[0] - FIRST, 0)  # other footage than that of `shot` begins elsewhere
        here, length = slice(first, first + given.length), max(stand_in.frames, first + given.length)
        motions = tuple(motion(length, seed)[here] for seed in range(len(given.performers)))
        result = track_result(given, motions, footage_offset=stand_in.footage_offset)
        result.torn, result.late, result.gaps = stand_in.torn, stand_in.late, stand_in.gaps
        result.turns = stand_in.turns
        result.rates = stand_in.rates
        return result

    monkeypatch.setattr(retracking, "track", track)
    monkeypatch.setattr(shot_cameras, "camera_fits", lambda *_: ())
    return stand_in
