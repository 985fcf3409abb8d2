"""What is tracked depends neither on the instructions that a processor has, nor on the libraries' kernels for it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from short_walk import short_walk

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
from kfmocap.core.tracking.solvers import limb_search
from kfmocap.core.tracking.tracker import track
searched, look = [], limb_search._likeliest
limb_search._likeliest = lambda *given: searched.append(1) or look(*given)
shot = load_shot(sys.argv[1])
joints = part_poses(shot.performers[0].body, track(shot).motions[0])[1]
np.savez(sys.argv[2], joints=joints, searched=len(searched))
"""


@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="these are the names of processors of one kind"
)
def test_an_older_processor_tracks_the_same_motion(tmp_path: Path) -> None:
    """A walk in one view, where limbs are looked for: differences in the last bits would end elsewhere there."""
    shot = (
        short_walk(tmp_path / "walk", 14, views=1, keyframes=(0, 13), settings=["working_size = 120", "threads = 1"])
        / "shot.toml"
    )
    motions = []
    for name, older in (("this", {}), ("older", OLDER)):
        out = tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, "-c", CODE, shot, out], env=os.environ | older, check=True)
        motions.append(np.load(out))
    this, older = motions
    assert this["searched"] > 0
    assert not np.array_equal(this["joints"], older["joints"])  # the kernels differ
    assert np.abs(this["joints"] - older["joints"]).max() < 1e-10
