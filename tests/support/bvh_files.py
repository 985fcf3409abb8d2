"""BVH files by the format's own definition, and motions to put into them."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from scipy.spatial.transform import Rotation

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def wild(body: Body, frames: int = 4, seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    turns = rotations.exp(rng.normal(0, 0.8, (frames, len(body), 3)))
    return Motion(rng.normal(0, 1, (frames, 3)), turns)


def bvh_text(body: Body, motion: Motion, order: str = "XYZ") -> str:
    """The motion as BVH."""
    R, T = part_poses(body, motion)
    rest = np.stack([part.R_world_rest for part in body.parts])
    turns = Y_UP @ (R @ np.swapaxes(rest, -1, -2)) @ Y_UP.T
    rows = [[] for _ in range(len(motion))]

    def joint(i: int) -> str:
        part, parent = body.parts[i], body.parts[i].parent
        offset = Y_UP @ (part.head_world if parent < 0 else part.head_world - body.parts[parent].head_world)
        local = turns[:, i] if parent < 0 else np.swapaxes(turns[:, parent], -1, -2) @ turns[:, i]
        angles = Rotation.from_matrix(local).as_euler(order, degrees=True)
        for f, row in enumerate(rows):
            row += [*(Y_UP @ T[f, 0] if parent < 0 else ()), *angles[f]]
        channels = [f"{axis}rotation" for axis in order]
        if parent < 0:
            channels = ["Xposition", "Yposition", "Zposition", *channels]
        children = [joint(k) for k, child in enumerate(body.parts) if child.parent == i]
        tip = Y_UP @ (part.tail_world - part.head_world)
        end = f"End Site {{ OFFSET {tip[0]} {tip[1]} {tip[2]} }}"
        return (
            f"{'ROOT' if parent < 0 else 'JOINT'} {part.name} {{ OFFSET {offset[0]} {offset[1]} {offset[2]}\n"
            f"CHANNELS {len(channels)} {' '.join(channels)}\n{''.join(children) or end} }}\n"
        )

    hierarchy = joint(0)
    lines = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in rows)
    return f"HIERARCHY\n{hierarchy}MOTION\nFrames: {len(rows)}\nFrame Time: 0.04\n{lines}\n"
