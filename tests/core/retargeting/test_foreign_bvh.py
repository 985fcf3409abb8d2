"""BVH files as other programs write them: their names, axes, units, channels, and joints without length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from foreign_skeletons import foreign_skeleton
from kfmocap.core.body import human
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.formats.bvh import read_bvh
from kfmocap.core.retargeting.retarget import prepared, retarget
from kfmocap.core.retargeting.transfer import RetargetOptions
from made_rigs import made_rig, moved_body
from render.motions import MOTIONS
from scipy.spatial.transform import Rotation

BODY, FRAMES, FPS = human(1.75), 24, 120.0
SOURCE = moved_body(BODY, MOTIONS["walk"](BODY, FRAMES, FPS), FPS)
PARTS = {"spine": "chest", "hips": "pelvis", "neck": "head", "head": "head"}
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Convention:
    """How a program writes BVH: kind of skeleton, order of angles, units per metre, axes, places of all joints."""

    skeleton: str
    order: str
    unit: float
    up: np.ndarray
    places: bool = False


CONVENTIONS = {
    "CMU": Convention("cmu", "ZYX", 56.4 / 2.54, Y_UP),
    "Xsens": Convention("xsens", "YXZ", 100.0, Y_UP),
    "Axis Neuron": Convention("axis neuron", "YXZ", 100.0, Y_UP, places=True),
    "Rokoko": Convention("rokoko", "ZXY", 100.0, Y_UP, places=True),
    "Biped": Convention("biped", "ZXY", 39.37, np.eye(3)),
    "Blender": Convention("reallusion", "XYZ", 1.0, np.eye(3)),
}


def written(convention: Convention) -> str:
    """The walk on a program's skeleton in T pose, as that program would write it."""
    rest, roles = foreign_skeleton(convention.skeleton, 0.0)
    turns = _turns(rest, roles)
    heads = rest.heads @ convention.up.T * convention.unit
    turns = convention.up @ turns @ convention.up.T
    root = SOURCE.positions[:, SOURCE.rest.indices(["pelvis"])[0]] @ convention.up.T * convention.unit
    children = [[k for k, p in enumerate(rest.parents) if p == j] for j in range(len(rest.names))]
    lines, visited = ["HIERARCHY"], []

    def joint(j: int, depth: int) -> None:
        pad, above = "\t" * depth, rest.parents[j]
        offset = heads[j] - heads[above] if above >= 0 else 0 * heads[j]
        places = "Xposition Yposition Zposition " if above < 0 or convention.places else ""
        angles = " ".join(f"{axis}rotation" for axis in convention.order)
        visited.append(j)
        lines.append(f"{pad}{'ROOT' if above < 0 else 'JOINT'} {rest.names[j].replace(' ', '_')}")
        lines.extend([f"{pad}{{", f"{pad}\tOFFSET " + " ".join(f"{x:.6f}" for x in offset)])
        lines.append(f"{pad}\tCHANNELS {6 if places else 3} {places}{angles}")
        for k in children[j]:
            joint(k, depth + 1)
        if not children[j]:
            lines.extend([f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET 0.0 0.0 0.0", f"{pad}\t}}"])
        lines.append(f"{pad}}}")

    joint(0, 0)
    lines += ["MOTION", f"Frames: {FRAMES}", f"Frame Time: {1 / FPS:.7f}"]
    for f in range(FRAMES):
        row = []
        for j in visited:
            above = rest.parents[j]
            own = turns[f, j] if above < 0 else turns[f, above].T @ turns[f, j]
            if above < 0 or convention.places:
                row += list(root[f] if above < 0 else heads[j] - heads[above])
            row += list(Rotation.from_matrix(own).as_euler(convention.order, degrees=True))
        lines.append(" ".join(f"{x:.6f}" for x in row))
    return "\n".join(lines) + "\n"


def _turns(rest: RestSkeleton, roles: dict[str, tuple[str, ...]]) -> np.ndarray:
    """Rotations (F, J, 3, 3) of the skeleton's bones: those of the body's parts, else of what is above."""
    part_of = {}
    for role, names in roles.items():
        for name in names:
            part = PARTS.get(role, role)
            if part in SOURCE.rest.names:
                part_of[name] = SOURCE.rest.names.index(part)
    found = np.empty((FRAMES, len(rest.names), 3, 3))
    for j, (name, above) in enumerate(zip(rest.names, rest.parents, strict=True)):
        inherited = SOURCE.turns[:, 0] if above < 0 else found[:, above]
        found[:, j] = SOURCE.turns[:, part_of[name]] if name in part_of else inherited
    return found


@pytest.mark.parametrize("program", CONVENTIONS)
def test_limbs_point_where_the_performers_do(program, tmp_path):
    file = tmp_path / "walk.bvh"
    file.write_text(written(CONVENTIONS[program]))
    source, bones = prepared(read_bvh(file))
    assert source.fps == pytest.approx(FPS, rel=1e-4)
    rig = made_rig("unreal", BODY, 0.5, 3)
    poses = retarget(source, bones, rig, RetargetOptions(feet="off")).poses
    for side in "LR":
        for upper, lower in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot")):
            a, b = (rig.index(f"{limb}.{side}") for limb in (upper, lower))
            [p] = SOURCE.rest.indices([f"{upper}.{side}"])
            own = SOURCE.turns[:, p] @ _along(source.rest, bones.bones, upper, lower, side)
            assert np.degrees(_angle(poses.places[:, b] - poses.places[:, a], own)).max() < 0.2, (upper, side)
    scale = retarget(source, bones, rig).placement.scale
    moved = np.linalg.norm(np.diff(poses.places[:, rig.index("hips")], axis=0), axis=1).sum()
    walked = np.linalg.norm(np.diff(SOURCE.positions[:, 0], axis=0), axis=1).sum()
    assert moved == pytest.approx(walked * scale * CONVENTIONS[program].unit, rel=0.05)


def _along(rest: RestSkeleton, bones: dict[str, tuple[str, ...]], upper: str, lower: str, side: str) -> np.ndarray:
    """Where a limb of the file's skeleton leads at rest: its proportions are not quite the body's."""
    a, b = rest.heads[rest.indices([bones[f"{upper}.{side}"][0], bones[f"{lower}.{side}"][0]])]
    return (b - a) / np.linalg.norm(b - a)


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    cosine = np.sum(a * b, axis=-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.arccos(np.clip(cosine, -1, 1))
