"""How people hold arms and legs, from captured clips: makes the tables of `limb_postures` in
`core.keypoints.keypoint_motion`.

    python tools/captured_postures.py CLIPS

CLIPS is the folder of DeepMimic's captured clips (humanoid3d_*.txt), as in `pybullet_data/data/motions` of the package
pybullet. Every clip counts alike, and every posture of the right side as one of the left.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from kfmocap.core.keypoints.keypoint_motion.closed_form import along_and_across
from kfmocap.core.numerics.arrays import Array
from scipy.cluster.vq import kmeans2
from scipy.spatial.transform import Rotation

POSTURES = 24
"""Rows of each table."""
SAMPLES = 400
"""Postures drawn from every clip."""
CHEST, SHOULDERS = (0.0, 0.236, 0.0), (-0.024, 0.2435, 0.0)
"""Where the chest begins on the pelvis, and the middle of the shoulders on the chest, metres; x ahead, y up."""
LEFT, DOWN = (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)
"""The person's left on pelvis and chest, and where bones of limbs point on themselves."""
LIMBS = {"arm": (("chest", 24, "R"), ("chest", 38, "L")), "leg": (("pelvis", 15, "R"), ("pelvis", 29, "L"))}
"""What each limb hangs on, the first number of its joint's quaternion in a frame, after which its hinge's angle
follows, and its side.
"""


def postures_of_clip(frames: Array, limb: str) -> Array:
    """Return unit vectors along the upper and the lower bone of both limbs on F frames, shape (2 F, 6), relative to the
    trunk: x to the limb's own side, y from the hips to the shoulders, z ahead.
    """
    pelvis = _rotations(frames[:, 4:8])
    carriers = {"pelvis": pelvis, "chest": pelvis * _rotations(frames[:, 8:12])}
    up = pelvis.apply(CHEST) + carriers["chest"].apply(SHOULDERS)
    found = []
    for carrier, first, side in LIMBS[limb]:
        upper = carriers[carrier] * _rotations(frames[:, 1 + first : 5 + first])
        lower = upper * Rotation.from_rotvec(frames[:, 5 + first, None] * [0.0, 0.0, 1.0])
        trunk = along_and_across(up, carriers[carrier].apply(LEFT))
        own_side = [1.0 if side == "L" else -1.0, 1.0, 1.0]
        bones = [np.einsum("fba,fb->fa", trunk, bone.apply(DOWN)) * own_side for bone in (upper, lower)]
        found.append(np.concatenate(bones, axis=1))
    return np.concatenate(found)


def _rotations(quaternions: Array) -> Rotation:
    return Rotation.from_quat(quaternions, scalar_first=True)


def table(clips: list[Array], limb: str) -> list[tuple[float, ...]]:
    """Return rows of a share and the unit vectors along both bones, the most common posture first."""
    rng = np.random.default_rng(0)
    samples = np.concatenate([rng.choice(postures_of_clip(frames, limb), SAMPLES) for frames in clips])
    centres, which = kmeans2(samples, POSTURES, minit="++", seed=0)
    share = np.bincount(which, minlength=POSTURES) / len(samples)
    bones = centres.reshape(-1, 2, 3)
    bones = bones / np.linalg.norm(bones, axis=2, keepdims=True)
    rows = np.column_stack([share, bones.reshape(-1, 6)])
    return [tuple(row) for row in rows[np.argsort(-share)].round(2).tolist()]


def main() -> None:
    """Print both tables."""
    files = sorted(Path(sys.argv[1]).glob("humanoid3d_*.txt"))
    clips = [np.array(json.loads(file.read_text(encoding="utf-8"))["Frames"]) for file in files]
    for limb in LIMBS:
        print(limb)
        for row in table(clips, limb):
            print(f"    {row},")


if __name__ == "__main__":
    main()
