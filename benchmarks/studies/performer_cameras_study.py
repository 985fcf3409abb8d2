"""A study of cameras found from a performer.

The shots' own calibrations are the truth. The cameras found are aligned with it as a whole by a similarity; what
remains is the error of each camera relative to the others. The tilt of the world is reported separately.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.calibration.performer.performer_cameras import PerformerCalibration, cameras_by_performer
from ...core.calibration.performer.performer_views import PerformerView
from ...core.calibration.solving.camera_rig import rig_of
from ...core.cameras.camera import Camera
from ...core.formats.keypoint_files import read_shot_keypoints
from ...core.tracking.prepare import load_shot

USUAL_HEIGHT = 1.75
"""Metres; determines the scale, which is not evaluated."""
HEAD = (
    "| shot | cameras | lenses | turned by, degrees | off, mm | of a distance of, m | focal length off, % "
    "| expected, % | tilt, degrees | seconds |\n| --- | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def rows(path: Path) -> list[str]:
    """Return the rows of the table for a shot, without and with its lenses given."""
    shot = load_shot(path)
    true, found = [view.camera for view in shot.views], read_shot_keypoints(shot)
    table = []
    for lenses in (False, True):
        views = [
            PerformerView(view.camera.name, view.camera.size, seen, view.offset, view.camera if lenses else None)
            for view, seen in zip(shot.views, found, strict=True)
        ]
        begin = time.process_time()
        result = cameras_by_performer(views, USUAL_HEIGHT, (0, shot.length - 1), correlated=0.3 * shot.fps)
        seconds = time.process_time() - begin
        kind = "known" if lenses else "found"
        table.append(f"| {path.parent.name} | {len(true)} | {kind} | {_errors(result, true)} | {seconds:.0f} |")
    return table


def _errors(result: PerformerCalibration, true: Sequence[Camera]) -> str:
    """Return the columns with the cameras' errors, each the largest of all cameras."""
    found = [result.cameras[camera.name] for camera in true]
    R, R_true = (np.stack([camera.R_cam_world[0] for camera in some]) for some in (found, true))
    places, wanted = (rig_of(some).centres_world for some in (found, true))
    world = Rotation.from_matrix(np.swapaxes(R_true, 1, 2) @ R).mean()
    turns = Rotation.from_matrix(R @ world.inv().as_matrix() @ np.swapaxes(R_true, 1, 2)).magnitude()
    turned, wanted = world.apply(places - places.mean(axis=0)), wanted - wanted.mean(axis=0)
    scale = (turned * wanted).sum() / (turned**2).sum()
    off = np.linalg.norm(scale * turned - wanted, axis=1)
    focal = [camera.matrix[0, 0] / one.matrix[0, 0] - 1 for camera, one in zip(found, true, strict=True)]
    columns = [
        f"{np.degrees(turns).max():.1f}",
        f"{1000 * off.max():.0f}",
        f"{np.linalg.norm(wanted, axis=1).mean():.1f}",
        f"{100 * np.abs(focal).max():.0f}",
        f"{100 * max(result.focal_deviation.values()):.0f}",
        f"{np.degrees(np.arccos(min(world.as_matrix()[2, 2], 1.0))):.1f}",
    ]
    return " | ".join(columns)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m kfmocap.benchmarks.studies.performer_cameras_study", description=__doc__
    )
    parser.add_argument("shots", nargs="+", type=Path, metavar="SHOT.toml", help="keypoints, and a true calibration")
    print(HEAD)
    for path in parser.parse_args().shots:
        for row in rows(path):
            print(row, flush=True)


if __name__ == "__main__":
    main()
