"""The rendered figure: a smooth skin around a body's bones, coloured like clothes. Needs no Blender.

Each part carries a few rounded shapes. Their smooth union is meshed once, in a relaxed stance, and the
distances to the shapes also give the skin weights, so that the skin bends smoothly at the joints. It differs
from the tracker's body model on purpose: a test on the tracker's own model would prove nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from numpy.typing import NDArray

from .figure_pose import hanging_arm
from .isosurface import mesh_isosurface
from .shapes import Shape, human_shapes
from .textures import noise

UNION = 0.010
"""Width of the smooth transition between shapes, metres."""
BLEND = 0.022
"""Scale of the skin weights at a joint: difference of the distances to its two parts, metres."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A skinned mesh.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        In the stance in which it was meshed, metres.
    triangles : ndarray of int, shape (N, 3)
    weights : ndarray, shape (V, P)
        Skin weight of every part; rows sum to 1.
    colours : ndarray, shape (V, 3)
        sRGB, 0..1.
    R_stance, T_stance : ndarray, shape (P, 3, 3) and (P, 3)
        World poses of the parts in that stance.
    """

    body: Body
    vertices: Array
    triangles: NDArray[np.int64]
    weights: Array
    colours: Array
    R_stance: Array
    T_stance: Array

    def posed(self, motion: Motion) -> Array:
        """Vertices in the world on every frame, shape (F, V, 3): linear blend skinning."""
        return self.skinned(*part_poses(self.body, motion))

    def skinned(self, R: Array, T: Array) -> Array:
        """Vertices in the world, shape (F, V, 3), of parts with world poses R (F, P, 3, 3) and T (F, P, 3)."""
        turn = R @ np.swapaxes(self.R_stance, -1, -2)
        shift = T - np.einsum("fpab,pb->fpa", turn, self.T_stance)
        frames = []
        for turn_f, shift_f in zip(turn, shift, strict=True):
            A = np.einsum("vp,pab->vab", self.weights, turn_f)
            frames.append(np.einsum("vab,vb->va", A, self.vertices) + self.weights @ shift_f)
        return np.array(frames)


def make_figure(
    body: Body,
    voxel: float = 0.007,
    shapes: Sequence[Shape] | None = None,
    paint: Callable[[Body, NDArray[np.int64], Array], Array] | None = None,
    *,
    pose: Motion | None = None,
) -> Figure:
    """Mesh and colour a body's figure and compute its skin weights.

    Parameters
    ----------
    voxel : float
        Edge length of the grid that is meshed, metres.
    shapes : sequence of Shape, optional
        Those of another person; by default `human_shapes`.
    paint : callable, optional
        From the body, the nearest part (V,) and the place in its frame (V, 3) of every vertex to colours (V, 3).
    pose : Motion, optional
        The one in which it is meshed; by default a human's `stance`.
    """
    shapes = human_shapes(body) if shapes is None else shapes
    R, T = (poses[0] for poses in part_poses(body, stance(body) if pose is None else pose))

    def distances(points: Array) -> Array:
        parts = [body.index(shape.part) for shape in shapes]
        return np.stack(
            [shape.distance((points - T[i]) @ R[i]) for shape, i in zip(shapes, parts, strict=True)], axis=-1
        )

    def union(points: Array) -> Array:
        d = -distances(points) / UNION
        top = d.max(axis=-1)
        return -UNION * (top + np.log(np.exp(d - top[:, None]).sum(axis=-1)))

    reach = np.array([0.35, 0.35, 0.45])
    vertices, triangles = mesh_isosurface(union, T.min(axis=0) - reach, T.max(axis=0) + reach, voxel)
    per_part = np.full((len(vertices), len(body)), np.inf)
    for shape, d in zip(shapes, distances(vertices).T, strict=True):
        i = body.index(shape.part)
        per_part[:, i] = np.minimum(per_part[:, i], d)
    nearest = per_part.argmin(axis=1)
    local = np.einsum("vab,va->vb", R[nearest], vertices - T[nearest])
    return Figure(body, vertices, triangles, _weights(body, per_part), (paint or _clothes)(body, nearest, local), R, T)


def stance(body: Body) -> Motion:
    """Arms hanging clear of the trunk, feet apart: halfway between the poses that the skin takes in the motions."""
    Q = np.broadcast_to(np.eye(3), (1, len(body), 3, 3)).copy()
    T = np.array([body.parts[0].head_world])
    for side, sign in (("L", 1.0), ("R", -1.0)):
        Q[:, body.index(f"upper_arm.{side}")] = hanging_arm(sign, np.zeros(1), np.radians([55.0])).as_matrix()
        spread = np.radians(sign * 6)
        c, s = np.cos(spread), np.sin(spread)
        Q[:, body.index(f"thigh.{side}")] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return Motion(T, Q)


def _weights(body: Body, per_part: Array) -> Array:
    """Skin weights by distance, shared by the nearest part, its parent and its children."""
    nearest = per_part.argmin(axis=1)
    related = np.eye(len(body), dtype=bool)
    for i, p in enumerate(body.parents):
        if p >= 0:
            related[i, p] = related[p, i] = True
    excess = per_part - per_part.min(axis=1, keepdims=True)
    w = np.where(related[nearest], np.exp(-excess / BLEND), 0.0)
    w[w < 0.02] = 0
    return w / w.sum(axis=1, keepdims=True)


def _clothes(body: Body, nearest: NDArray[np.int64], local: Array) -> Array:
    """Colour every vertex in sRGB, from its part and its position on it: checked shirt, jeans, shoes, skin and hair."""
    kind = np.array([name.split(".")[0] for name in body.names])[nearest]
    lengths = np.array([np.linalg.norm(p.tail_world - p.head_world) for p in body.parts])
    place = local[:, 1] / lengths[nearest]
    seed_shift = nearest[:, None] * 1.7
    coarse, fine = noise(local / 0.06 + seed_shift), noise(local / 0.016 + seed_shift)
    grain = 0.10 * coarse + 0.14 * fine
    colours = np.tile([0.78, 0.58, 0.47], (len(local), 1))  # skin

    def paint(where: Array, colour: Array | list[float]) -> None:
        colours[where] = np.broadcast_to(colour, colours.shape)[where]

    trunk = np.isin(kind, ["spine", "chest"])
    sleeve = (kind == "upper_arm") | ((kind == "forearm") & (place < 0.45))
    around = np.where(sleeve, np.arctan2(local[:, 2], local[:, 0]) * 0.045, local[:, 0])
    bands = (np.mod(local[:, 1], 0.075) < 0.03).astype(float) + (np.mod(around, 0.07) < 0.028)
    checks = np.array([[0.70, 0.28, 0.22], [0.46, 0.17, 0.18], [0.20, 0.12, 0.17]])
    paint(trunk | sleeve, checks[bands.astype(int)])
    paint((kind == "chest") & (place > 1.12), [0.74, 0.54, 0.44])
    jeans = np.isin(kind, ["pelvis", "thigh", "shin"])
    worn = np.clip(0.4 + 0.6 * coarse + 0.35 * (kind == "thigh") * (local[:, 2] > 0.02), 0, 1)[:, None]
    paint(jeans, (1 - worn) * [0.16, 0.22, 0.36] + worn * [0.38, 0.47, 0.62])
    paint(jeans & (kind != "pelvis") & (np.abs(local[:, 2]) < 0.006), [0.62, 0.50, 0.32])  # seams
    paint((kind == "pelvis") & (place > 0.62), [0.16, 0.11, 0.08])  # belt
    paint(kind == "foot", [0.22, 0.21, 0.22])
    head, hair_line = kind == "head", 0.262 - 1.3 * np.clip(0.07 - local[:, 2], 0, 0.12)
    paint(head & (local[:, 1] > np.maximum(hair_line, 0.13)), [0.24, 0.16, 0.10])
    eye = np.hypot(np.abs(local[:, 0]) - 0.03, local[:, 1] - 0.185) < 0.011
    paint(head & eye & (local[:, 2] > 0.05), [0.12, 0.09, 0.08])
    skin = head | (kind == "hand")
    colours += np.where(skin, 0.35, 1.0)[:, None] * grain[:, None]
    return np.clip(colours, 0.02, 0.95)
