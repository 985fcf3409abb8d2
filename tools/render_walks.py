#!/usr/bin/env python3
"""Render walks of many kinds, with exact truth and a detector's keypoints; needs no Blender.

    .venv/bin/python tools/render_walks.py --out build/walks [march run]

Files and options are those of render_benchmark.py. `kfmocap bench --shots --data build/walks` measures them.
"""

from __future__ import annotations

from render.chosen_shots import render_chosen
from render.walk_shots import WALK_PLANS
from render_benchmark import preview, render_shot


def main() -> None:
    """Render walks, or previews of some frames."""
    render_chosen(
        __doc__,
        WALK_PLANS,
        lambda name, out: render_shot(WALK_PLANS[name], out),
        lambda name, frames, out: preview(WALK_PLANS[name], frames, out),
    )


if __name__ == "__main__":
    main()
