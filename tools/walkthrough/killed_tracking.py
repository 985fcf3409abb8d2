"""Tracks in Blender's window while processes are killed; tools/kill_blender.py starts it.

    blender --python killed_tracking.py -- WORK SHOT KILLS SEED LIBRARIES

With KILLS the worker is killed so many times, at random moments of trackings, and after each the scene must be as it
was. With 0 kills the scene is tracked again and again, and saved while it is, until Blender itself is killed. WORK
holds the scene, scene.blend, which is made from the shot or opened and looked at if it is there, and what happens, as
lines of text in `said`.
"""

from __future__ import annotations

import hashlib
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

WORK, SHOT, KILLS, SEED, LIBRARIES = sys.argv[sys.argv.index("--") + 1 :]
sys.path[:0] = [path for path in LIBRARIES.split(os.pathsep) if path]
SCENE = Path(WORK, "scene.blend")
SAVES = 0.3
"""Seconds between savings while tracking."""


def say(text: str) -> None:
    """Tell the program outside."""
    with Path(WORK, "said").open("a") as file:
        file.write(f"{text}\n")


def keys() -> str:
    """A checksum of all keys in the file."""
    found = hashlib.sha256()
    for action in sorted(bpy.data.actions, key=lambda one: one.name):
        for layer in action.layers:
            for strip in layer.strips:
                for bag in strip.channelbags:
                    for curve in bag.fcurves:
                        numbers = [round(x, 6) for point in curve.keyframe_points for x in point.co]
                        found.update(repr((curve.data_path, curve.array_index, numbers)).encode())
    return found.hexdigest()


def begin() -> int:
    """Start tracking; returns the worker's id."""
    from kfmocap.kfmocap_addon.operators.job_operator import running_job

    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        bpy.ops.kfmocap.track("INVOKE_DEFAULT")
    job = running_job(window)
    return job.process_id if job is not None else 0


def ended() -> bool:
    """Whether nothing is tracked."""
    from kfmocap.kfmocap_addon.operators.job_operator import running_job

    return running_job(bpy.context.window_manager.windows[0]) is None


def steps() -> Iterator[float]:
    """The work, which yields how many seconds to wait."""
    from kfmocap import kfmocap_addon
    from kfmocap.core.tracking.prepare import load_shot
    from kfmocap.kfmocap_addon.scene_io import scene

    kfmocap_addon.register()
    if SCENE.exists():
        bpy.ops.wm.open_mainfile(filepath=str(SCENE))
        yield 0.1
        say(f"opened {keys()}")
    else:
        scene.build_scene(load_shot(Path(SHOT)), scene=bpy.context.scene)
        bpy.ops.wm.save_as_mainfile(filepath=str(SCENE))
        say(f"made {keys()}")
    yield from tracked_until_killed() if KILLS == "0" else tracked_by_workers_that_are_killed()
    say("done")
    bpy.ops.wm.quit_blender()


def tracked_until_killed() -> Iterator[float]:
    """Track again and again, and save meanwhile."""
    saved = time.monotonic()
    while True:
        say(f"tracking {os.getpid()} {begin()}")
        while not ended():
            if time.monotonic() > saved + SAVES:
                bpy.ops.wm.save_mainfile()
                saved = time.monotonic()
            yield 0.02
        bpy.ops.wm.open_mainfile(filepath=str(SCENE))
        yield 0.1


def tracked_by_workers_that_are_killed() -> Iterator[float]:
    """Track, kill the worker, look at the scene, and save it."""
    before, begun = keys(), time.monotonic()
    begin()
    while not ended():
        yield 0.02
    seconds, chance = time.monotonic() - begun, random.Random(int(SEED))
    say(f"tracked {keys() != before}")
    before, killed = keys(), 0
    while killed < int(KILLS):
        worker, until = begin(), time.monotonic() + chance.uniform(0, seconds)
        while time.monotonic() < until and not ended():
            yield 0.01
        hit = not ended()
        if hit:
            os.kill(worker, signal.SIGKILL)
            killed += 1
        until = time.monotonic() + 2
        while not ended() and time.monotonic() < until:
            yield 0.01
        bpy.ops.wm.save_mainfile()
        if hit:
            say(f"killed {ended() and keys() == before and not Path(f'/proc/{worker}/stat').exists()}")


def main() -> None:
    """Take one step after the other, from Blender's timer."""
    work = steps()

    def tick() -> float | None:
        try:
            return next(work)
        except StopIteration:
            return None
        except Exception as error:
            say(f"failed {type(error).__name__}: {error}")
            sys.stdout.flush()
            os._exit(1)

    bpy.app.timers.register(tick, first_interval=0.5, persistent=True)


main()
