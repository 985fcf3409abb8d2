"""What is tracked depends neither on the instructions that a processor has, nor on the libraries' kernels for it."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from keypoint_shots import NAMES, write_openpose
from kfmocap.core.body import part_poses
from kfmocap.core.formats import load_cameras, read_trc
from kfmocap.core.tracking.prepare import load_shot
from kfmocap.core.tracking.solvers.limb_corrections import limb_search
from kfmocap.core.tracking.tracker import track
from short_walk import WALK, short_walk

pytestmark = pytest.mark.long
OLDER = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENCV_CPU_DISABLE": "AVX2,FMA3,AVX",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3",
}
CODE = """
import sys, numpy as np
from kfmocap.core.body import part_poses
from kfmocap.core.tracking.prepare import load_shot
from kfmocap.core.tracking.tracker import track
for path, out in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
    shot = load_shot(path)
    np.save(out, part_poses(shot.performers[0].body, track(shot).motions[0])[1])
"""


FRAMES, LONG = 8, 30
QUICK = ["working_size = 120", "threads = 1"]


def searched_walk(folder: Path) -> Path:
    """A walk in one view, where limbs are looked for: differences in the last bits would end elsewhere there."""
    return short_walk(folder, FRAMES, views=1, keyframes=(0, FRAMES - 1), settings=QUICK) / "shot.toml"


def relaxed_walk(folder: Path) -> Path:
    """A walk that is solved by relaxation: its initial solution goes from frame to frame, so that differences grow with
    the number of frames.
    """
    settings = ["working_size = 160", "threads = 1", 'solver = "relaxation"', "sweeps = 100"]
    return short_walk(folder, LONG, views=1, keyframes=(0, LONG - 1), settings=settings) / "shot.toml"


def walk_from_keypoints(folder: Path) -> Path:
    """A walk of whose performer a detector's keypoints are all that is known."""
    made, landmarks = short_walk(folder, FRAMES, views=2, settings=QUICK), read_trc(WALK / "landmarks.trc")
    at = [landmarks.names.index(name) if name in landmarks.names else -1 for name in NAMES]
    places = np.concatenate([landmarks.points_world[:FRAMES], np.full((FRAMES, 1, 3), np.nan)], axis=1)[:, at]
    text = (made / "shot.toml").read_text()
    for name, camera in load_cameras(WALK / "calibration.toml").items():
        write_openpose(made / f"{name}_json", camera, [places], noise=1.0)
        text = text.replace(f'footage = "{name}.mp4"\n', f'footage = "{name}.mp4"\nkeypoints = "{name}_json"\n')
    text = re.sub(r"landmarks = .*\n", "", text)
    shot = made / "shot.toml"
    shot.write_text(re.sub(r"keyframes = .*\n", 'keyframes = "auto"\n', text))
    return shot


@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="these are the names of processors of one kind"
)
def test_an_older_processor_tracks_the_same_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds, searched = (searched_walk, relaxed_walk, walk_from_keypoints), []
    shots = {made: made(tmp_path / made.__name__) for made in kinds}
    saved = {made: tmp_path / f"{made.__name__}.npy" for made in shots}
    paths = [path for made, shot in shots.items() for path in (shot, saved[made])]
    subprocess.run([sys.executable, "-c", CODE, *paths], env=os.environ | OLDER, check=True)
    search = limb_search.likeliest_limb
    monkeypatch.setattr(limb_search, "likeliest_limb", lambda *given: searched.append(given) or search(*given))
    for made, shot in shots.items():
        loaded = load_shot(shot)
        this, older = part_poses(loaded.performers[0].body, track(loaded).motions[0])[1], np.load(saved[made])
        assert searched, "the first of them"
        assert not np.array_equal(this, older), made  # the kernels differ
        assert np.abs(this - older).max() < 1e-10, made
