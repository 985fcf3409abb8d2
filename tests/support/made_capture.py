"""A small capture of a wand, as files."""

from __future__ import annotations

from pathlib import Path

from kfmocap.benchmarks.studies.wand_captures import capture, ring, scattered
from kfmocap.core.formats.marker_points import write_marker_points

HEAD = """
[lframe]
points = [[0,0,0],[0.3,0,0],[0.6,0,0],[0,0.2,0]]
[wand]
length = 0.5
"""


def made_capture(folder: Path, cameras: int = 3) -> Path:
    """Write a capture file of some cameras, and their points beside it."""
    given = capture(ring(cameras), [scattered(20)] * cameras)
    write_marker_points(folder / "points.csv", given)
    views = "".join(
        f'[[view]]\ncamera = "{view.camera}"\nsize = [1920, 1080]\nfps = 30\noffset = 0\n' for view in given.views
    )
    path = folder / "wand.toml"
    path.write_text(f'{HEAD}{views}[points]\nfile = "points.csv"\n')
    return path
