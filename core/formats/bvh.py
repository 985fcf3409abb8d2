"""BVH files: reading motions, and key poses from files with our exporter's joint names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..body import Body, default_measures, human
from ..body.human import FRACTIONS
from ..body.motion import Motion
from ..body.skeleton_motion import RestSkeleton, SkeletonMotion
from ..errors import BodyError, ShotError
from ..numerics.arrays import Array
from .reading import NUMBER_LIMIT, read_text, reading

_WORLD_OF_BVH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_MAX_JOINTS = 1000
_TOLERANCE = 2e-3  # metres
_LIMBS = ("upper_arm", "forearm", "thigh", "shin")


def read_bvh(path: Path) -> SkeletonMotion:
    """Read a BVH file (Y up) as a motion with Z up, in the file's unit of length; it is named after the file.

    Raises
    ------
    ShotError
        The file cannot be read or is not a BVH file; names the file.
    """
    words = iter(read_text(path, "the BVH", ShotError).split())
    with reading(path, "a BVH file", ShotError):
        return _parsed(words, path.stem)


@dataclass(frozen=True, eq=False)
class _Hierarchy:
    """The J joints of a file, in its axes and unit of length.

    Attributes
    ----------
    names : list of str
    parents : list of int
        Index of each joint's parent; -1 for roots.
    offsets, tips : ndarray, shape (J, 3)
        Where a joint is at rest relative to its parent, and where its bone ends relative to it; NaN without an end.
    channels : list of list of str
    """

    names: list[str]
    parents: list[int]
    offsets: Array
    tips: Array
    channels: list[list[str]]


def _parsed(words: Iterator[str], name: str) -> SkeletonMotion:
    joints = _hierarchy(words)
    values, frame_time = _channel_values(words, joints)
    moved, turns = _motion(values, joints.channels, joints.parents, joints.offsets)
    C = _WORLD_OF_BVH
    moved, turns, steps = moved @ C.T, C @ turns @ C.T, joints.offsets @ C.T
    heads, positions = np.zeros_like(steps), np.empty(turns.shape[:3])
    for j, p in enumerate(joints.parents):
        heads[j] = steps[j] if p < 0 else heads[p] + steps[j]
        way = moved[:, j, :, None]
        positions[:, j] = moved[:, j] if p < 0 else positions[:, p] + (turns[:, p] @ way)[..., 0]
    rest = RestSkeleton(tuple(joints.names), tuple(joints.parents), heads, heads + joints.tips @ C.T)
    return SkeletonMotion(name, rest, turns, positions, 1 / frame_time if 1e-5 < frame_time < 1e5 else 0.0)


def _hierarchy(words: Iterator[str]) -> _Hierarchy:
    """Read the joints, up to the word MOTION."""
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    tips: list[list[float]] = []
    channels: list[list[str]] = []
    branch: list[int] = []
    at_tip = False
    _expect(next(words).upper(), "HIERARCHY")
    for word in map(str.upper, words):
        if word in ("ROOT", "JOINT"):
            names.append(" ".join(iter(words.__next__, "{")))  # "Bip01 L Thigh" is one name
            parents.append(branch[-1] if branch else -1)
            branch.append(len(names) - 1)
            offsets.append([0.0] * 3)
            tips.append([np.nan] * 3)
            channels.append([])
        elif word == "END":
            branch.append(branch[-1])
            at_tip = True
        elif word == "OFFSET":
            (tips if at_tip else offsets)[branch[-1]] = [_number(next(words)) for _ in range(3)]
        elif word == "CHANNELS":
            channels[branch[-1]] = [next(words) for _ in range(int(next(words)))]
        elif word == "}":
            branch.pop()
            at_tip = False
        elif word == "MOTION":
            break
    return _Hierarchy(names, parents, np.array(offsets), np.array(tips), channels)


def _channel_values(words: Iterator[str], joints: _Hierarchy) -> tuple[Array, float]:
    """Read the values of all channels on F frames, shape (F, C), and the seconds between two frames."""
    _expect(next(words), "Frames:")
    count = int(next(words))
    _expect(next(words) + next(words), "FrameTime:")
    frame_time = _number(next(words))
    numbers = np.array([_number(word) for word in words])
    J = len(joints.names)
    if not J or J > _MAX_JOINTS or count * J > max(len(numbers), 1):
        raise ValueError(f"{len(numbers)} numbers for {count} frames of {J} joints")
    columns = sum(map(len, joints.channels))
    if columns and len(numbers) % columns == 0:  # some programs write one frame more than they state
        numbers = numbers[: count * columns]
    return numbers.reshape(count, columns), frame_time


def _number(word: str) -> float:
    value = float(word)
    if not abs(value) <= NUMBER_LIMIT:
        raise ValueError(f"{word[:20]} is not finite, or too large to be true")
    return value


def _expect(word: str, wanted: str) -> None:
    if word != wanted:
        raise ValueError(f"{wanted} is missing, or it is cut off")


def _motion(values: Array, channels: list[list[str]], parents: list[int], offsets: Array) -> tuple[Array, Array]:
    """Return every joint's position relative to its parent (F, J, 3) and its global rotation (F, J, 3, 3), in the
    file's axes.

    Position channels, which some programs write for joints below the root, too, replace the joint's offset (J, 3).
    """
    positions = np.tile(offsets, (len(values), 1, 1))
    turns = np.empty((len(values), len(channels), 3, 3))
    column = 0
    for j, names in enumerate(channels):
        block = values[:, column : column + len(names)]
        column += len(names)
        if not names:
            turns[:, j] = np.eye(3) if parents[j] < 0 else turns[:, parents[j]]
            continue
        axes = "".join(name[0].upper() for name in names if name.endswith("rotation"))
        angles = block[:, [i for i, name in enumerate(names) if name.endswith("rotation")]]
        local = Rotation.from_euler(axes, angles, degrees=True).as_matrix()  # capitals: intrinsic rotations
        turns[:, j] = local if parents[j] < 0 else turns[:, parents[j]] @ local
        for i, name in enumerate(names):
            if name.endswith("position"):
                positions[:, j, "XYZ".index(name[0].upper())] = block[:, i]
    return positions, turns


def body_of_bvh(skeleton: SkeletonMotion, height: float | None = None) -> Body:
    """Return the default human with the bone lengths of a BVH file.

    Parameters
    ----------
    skeleton : SkeletonMotion
    height : float, optional
        Metres; by default estimated from the limbs.

    Raises
    ------
    BodyError
        The skeleton is not that of the default human.
    """
    strange = sorted(set(_human_like(skeleton).names) ^ set(skeleton.rest.names))
    if strange:
        todo = f"the joints must be {', '.join(human().names)}"
        raise BodyError(f"its joints are not the default body's: {', '.join(strange[:4])}", todo=todo)
    if height is None:
        measures = _fitted_measures(skeleton, 1.75)
        ratios = [measures[f"{limb}.{side}"] / FRACTIONS[limb] for limb in _LIMBS for side in "LR"]
        height = float(np.median(ratios))
    body = _human_like(skeleton, height, _fitted_measures(skeleton, height))
    apart = np.nan_to_num(np.abs(_rest(body) - _rest_of_bvh(skeleton, body))).max(axis=(1, 2))
    if apart.max() > _TOLERANCE:
        worst = body.names[int(apart.argmax())]
        todo = "the file must have the rest pose and the proportions of a body of this program: export it from there"
        raise BodyError(f"joint '{worst}' does not lie where the default body has it in its rest pose", todo=todo)
    return body


def _human_like(skeleton: SkeletonMotion, height: float = 1.75, measures: Mapping[str, float] | None = None) -> Body:
    """Return the default human, without collar bones if the skeleton has none."""
    collar_bones = any(name.startswith("shoulder.") for name in skeleton.rest.names)
    return human(height, measures, collar_bones=collar_bones)


def _fitted_measures(skeleton: SkeletonMotion, height: float) -> dict[str, float]:
    """Return the measures whose rest pose is the BVH's; those that it does not determine are an average person's."""
    average = default_measures(height)
    start = np.array(list(average.values()))
    target = _rest_of_bvh(skeleton, _human_like(skeleton))
    seen = np.isfinite(target)

    def residuals(x: Array) -> Array:
        body = _human_like(skeleton, height, dict(zip(average, x.tolist(), strict=True)))
        return np.concatenate([(_rest(body) - target)[seen], 1e-4 * (x - start)])

    # The rest pose is linear in the measures: a single step is exact, whatever the increment of the differences.
    step = 1e-3
    before = residuals(start)
    J = np.stack([(residuals(start + step * e) - before) / step for e in np.eye(len(start))], axis=1)
    measures = start - np.linalg.lstsq(J, before, rcond=None)[0]
    return dict(zip(average, measures.tolist(), strict=True))


def _rest(body: Body) -> Array:
    """Return every joint relative to its parent, and the tip of every bone without children relative to its joint,
    shape (P, 2, 3).
    """
    rest = np.full((len(body), 2, 3), np.nan)
    for i, part in enumerate(body.parts):
        if part.parent >= 0:
            rest[i, 0] = part.head_world - body.parts[part.parent].head_world
        if i not in body.parents:
            rest[i, 1] = part.tail_world - part.head_world
    return rest


def _rest_of_bvh(skeleton: SkeletonMotion, body: Body) -> Array:
    """Return the same as `_rest` for a skeleton, in the order of the body's parts."""
    order = [skeleton.rest.names.index(name) for name in body.names]
    heads, parents = skeleton.rest.heads, skeleton.rest.parents
    offsets = np.array([heads[j] - (heads[parents[j]] if parents[j] >= 0 else 0.0) for j in order])
    rest = np.stack([offsets, (skeleton.rest.tails - heads)[order]], axis=1)
    rest[np.isnan(_rest(body))] = np.nan
    return np.asarray(rest)


def poses_of_bvh(skeleton: SkeletonMotion, body: Body, rows: NDArray[np.int64]) -> Motion:
    """Return some rows of a BVH's motion as poses of a body whose parts have the joints' names."""
    order = [skeleton.rest.names.index(name) for name in body.names]
    rest = np.stack([part.R_world_rest for part in body.parts])
    R = skeleton.turns[rows][:, order] @ rest
    Q = np.empty_like(R)
    for i, p in enumerate(body.parents):
        before = body.R_parent_rest[i] if p < 0 else R[:, p] @ body.R_parent_rest[i]
        Q[:, i] = np.swapaxes(before, -1, -2) @ R[:, i]
    return Motion(skeleton.positions[rows, 0], Q)
