"""Small bodies, cameras and pictures whose truth is known, made without the code that they test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.body import Body, Part, part_poses
from kfmocap.core.body.human import bone_axes
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View

Array = np.ndarray
Poses = tuple[Array, Array]
SIZE = (160, 120)
CENTRE = (0.0, 0.0, 1.1)


def look_at(
    name: str, eye: Sequence[float], target: Sequence[float] = CENTRE, size: tuple[int, int] = SIZE, focal: float = 190
) -> Camera:
    """A camera that looks from one point at another, the world's z up in its picture."""
    eye = np.asarray(eye, float)
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera.create(name, size, K, R, -R @ eye)


CAMERAS = (look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3)))
"""Two cameras that see the figure from its front and from its side."""


def box(low: Sequence[float], high: Sequence[float]) -> Array:
    """The eight corners of a box, shape (8, 3)."""
    return np.array(list(product(*zip(low, high, strict=True))), float)


def part(name: str, parent: int, head: Sequence[float], tail: Sequence[float], half: float, depth: float) -> Part:
    """A box along a bone, a little tapered so that no two of its faces are alike."""
    head, tail = np.asarray(head, float), np.asarray(tail, float)
    length = np.linalg.norm(tail - head)
    vertices = box([-half, 0, -depth], [half, length, depth])
    vertices[vertices[:, 1] > 0] *= [0.8, 1, 0.9]
    hint = [0.0, -1.0, 0.0] if abs((tail - head)[1]) < 0.5 * length else [0.0, 0.0, 1.0]
    return Part(name, parent, head, tail, bone_axes(tail - head, np.array(hint)), vertices)


def figure() -> Body:
    """Four boxes: a trunk, an arm of two parts to its left, and one of a single part to its right."""
    parts = (
        part("trunk", -1, (0, 0, 0.75), (0, 0, 1.45), 0.2, 0.14),
        part("upper_arm.L", 0, (0.24, 0, 1.35), (0.55, 0, 1.3), 0.07, 0.06),
        part("forearm.L", 1, (0.55, 0, 1.3), (0.88, 0, 1.3), 0.055, 0.05),
        part("arm.R", 0, (-0.24, 0, 1.35), (-0.75, 0, 1.25), 0.07, 0.06),
    )
    tips = {p.name + " tip": (i, p.R_world_rest.T @ (p.tail_world - p.head_world)) for i, p in enumerate(parts)}
    return Body(parts, {**{p.name: (i, np.zeros(3)) for i, p in enumerate(parts)}, **tips})


def at_rest(body: Body, frames: int = 1) -> Motion:
    return Motion(np.tile(body.offsets[0], (frames, 1)), np.tile(np.eye(3), (frames, len(body), 1, 1)))


def random_motion(body: Body, frames: int, seed: int = 0, turn: float = 0.7, shift: float = 0.3) -> Motion:
    """Unrelated poses around the rest pose."""
    rng = np.random.default_rng(seed)
    rest = at_rest(body, frames)
    turns = rotations.exp(rng.normal(0, turn, (frames, len(body), 3)))
    return Motion(rest.translations + rng.normal(0, shift, (frames, 3)), turns)


def swing(body: Body, frames: int, size: float = 0.5, seed: int = 0) -> Motion:
    """A smooth motion that no spline through its ends tells: every joint swings out and back."""
    rng = np.random.default_rng(seed)
    phase = np.sin(np.pi * np.arange(frames) / (frames - 1))[:, None]
    drift = np.linspace(-0.5, 0.5, frames)[:, None]
    axes = rng.normal(0, 1, (2, len(body), 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    turns = size * (phase[:, :, None] * axes[0] + 0.4 * drift[:, :, None] * axes[1])
    turns[:, 0] *= 0.5
    path = 0.12 * phase * [1.0, 0.3, 0.4] + 0.1 * drift * [0.2, 0.5, -0.3]
    return Motion(at_rest(body, frames).translations + path, rotations.exp(turns))


def ends_held(body: Body, frames: int) -> Array:
    """The degrees of freedom that key poses on the first and the last frame hold, bool (frames, D)."""
    fixed = np.zeros((frames, body.dof), bool)
    fixed[[0, -1]] = True
    return fixed


def rigidly_moved(body: Body, motion: Motion, G: Array, s: Array) -> Motion:
    """The motion in a world that is turned by G, then shifted by s."""
    R0, Q = body.R_parent_rest[0], motion.rotations.copy()
    Q[:, 0] = R0.T @ G @ R0 @ Q[:, 0]
    return Motion(motion.translations @ G.T + s, Q)


def rigidly_moved_camera(camera: Camera, G: Array, s: Array) -> Camera:
    """The camera that sees the moved world as before."""
    R = camera.R_cam_world @ G.T
    return replace(camera, R_cam_world=R, t_cam_world=camera.t_cam_world - R @ s)


def numeric_jacobian(f: Callable[[Array], Array], x: Array, step: float = 1e-5) -> Array:
    """Central differences of a function of a vector, one column per component."""
    columns = []
    for i in range(len(x)):
        d = np.zeros(len(x))
        d[i] = step
        columns.append((np.asarray(f(x + d)) - np.asarray(f(x - d))) / (2 * step))
    return np.stack(columns, axis=-1)


def poses_of(bodies: Sequence[Body], motions: Sequence[Motion]) -> Poses:
    """World poses of all performers' parts, one performer after the other."""
    R, T = zip(*(part_poses(b, m) for b, m in zip(bodies, motions, strict=True)), strict=True)
    return np.concatenate(R, axis=1), np.concatenate(T, axis=1)


def cast(
    bodies: Sequence[Body], R: Array, T: Array, camera: Camera, frame: int, uv: Array
) -> tuple[Array, Array, Array]:
    """Cast a ray through every pixel at the parts, face by face: the truth for label and depth images.

    Parameters
    ----------
    R, T : ndarray, shape (P, 3, 3) and (P, 3)
    uv : ndarray, shape (N, 2)

    Returns
    -------
    part : ndarray of int, shape (N,)
        -1 where the ray meets none.
    depth : ndarray, shape (N,)
        z in the camera, metres.
    local : ndarray, shape (N, 3)
        The point met, in the part's frame.
    """
    Rc, tc = camera.pose(frame)
    rays = np.linalg.inv(camera.matrix) @ np.stack([*uv.T, np.ones(len(uv))])
    part, depth, local = np.full(len(uv), -1), np.full(len(uv), np.inf), np.zeros((len(uv), 3))
    for i, solid in enumerate(p for body in bodies for p in body.parts):
        at = _around(camera.project(solid.vertices @ R[i].T + T[i], frame), uv)
        if not len(at):
            continue
        planes = np.unique(solid.planes.round(12), axis=0)  # a face of four corners is listed as two triangles
        turn = R[i].T @ Rc.T
        origin = -turn @ tc - R[i].T @ T[i]
        direction = turn @ rays[:, at]
        speed = planes[:, :3] @ direction
        ahead = -(planes[:, :3] @ origin + planes[:, 3])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ahead / speed
        near = np.where(speed < 0, t, 0.0).max(axis=0)
        far = np.where(speed > 0, t, np.inf).min(axis=0)
        hit = (near < far) & (near > 0) & (near < depth[at])
        part[at[hit]], depth[at[hit]] = i, near[hit]
        local[at[hit]] = origin + (near * direction)[:, hit].T
    return part, depth, local


def _around(corners: Array, uv: Array, margin: float = 0.0) -> Array:
    """Indices of the pixels in the box around projected corners; of all where a corner is behind the camera.

    The box is larger by a margin, pixels, on every side.
    """
    if np.isnan(corners).any():
        return np.arange(len(uv))
    (left, top), (right, bottom) = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    u, v = uv.T
    return np.flatnonzero((u >= left) & (u <= right) & (v >= top) & (v <= bottom))


def pixel_grid(size: tuple[int, int]) -> Array:
    """Every pixel (u, v) of an image, row by row, shape (w h, 2)."""
    v, u = np.indices((size[1], size[0]))
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(float)


def texture(part: Array, local: Array, seed: int = 0) -> Array:
    """A smooth solid texture, grey level 0 to 1, of waves some 10 to 40 cm long."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(0, 25, (8, 3)), rng.uniform(0, 2 * np.pi, 8)
    angle = local @ waves.T + phases + 1.7 * part[:, None]
    return 0.5 + 0.09 * np.sin(angle).sum(axis=1)


def picture(bodies: Sequence[Body], poses: Poses, frame: int, camera: Camera, samples: int = 2) -> Array:
    """One frame of a camera, uint8 (h, w), each pixel the mean of several rays; a flat background."""
    R, T = poses
    solids = [p for body in bodies for p in body.parts]
    corners = [camera.project(p.vertices @ R[frame, i].T + T[frame, i], frame) for i, p in enumerate(solids)]
    grid = pixel_grid(camera.size)
    near = np.unique(np.concatenate([_around(c, grid, margin=1.0) for c in corners]))  # pixels that may meet a part
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    rays = np.concatenate([grid[near] + d for d in product(offsets, offsets)])
    part, _, local = cast(bodies, R[frame], T[frame], camera, frame, rays)
    met = part >= 0
    light = np.full(len(rays), 0.35)
    light[met] = texture(part[met], local[met])
    total = np.full(len(grid), 0.35 * samples**2)
    total[near] = light.reshape(samples**2, -1).sum(axis=0)
    grey = np.clip(255 * total / samples**2, 0, 255).round().astype(np.uint8)
    return grey.reshape(camera.size[1], camera.size[0])


def silhouette(
    bodies: Sequence[Body], poses: Poses, frame: int, camera: Camera, shift: Sequence[float] = (0, 0), samples: int = 4
) -> Array:
    """Foreground image of one frame as sharp as can be, uint8 (h, w): how much of each pixel is covered by a body.

    `shift` moves it in the picture, pixels.
    """
    R, T = poses
    grid = pixel_grid(camera.size) - np.asarray(shift, float)
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    rays = (cast(bodies, R[frame], T[frame], camera, frame, grid + d)[0] >= 0 for d in product(offsets, offsets))
    share = np.mean(list(rays), axis=0).reshape(camera.size[1], camera.size[0])
    return (128 + 124 * (2 * share - 1)).round().astype(np.uint8)


def dark(camera: Camera, frames: int) -> tuple[ViewFrames, ...]:
    """One view whose pictures show nothing."""
    return (ViewFrames(camera, np.full((frames, *camera.size[::-1]), 90, np.uint8), 0),)


def coloured(body: Body, motion: Motion, cameras: Sequence[Camera]) -> tuple[ViewFrames, ...]:
    """Views that tell the body from the background, and show nothing else."""
    poses = poses_of([body], [motion])
    shown = [np.stack([silhouette([body], poses, f, c, samples=1) for f in range(len(motion))]) for c in cameras]
    return tuple(ViewFrames(c, np.zeros_like(s), 0, s[None]) for c, s in zip(cameras, shown, strict=True))


def film(folder: Path, bodies: Sequence[Body], motions: Sequence[Motion], cameras: Sequence[Camera]) -> list[View]:
    """Film the motions: an image sequence per camera."""
    poses = poses_of(bodies, motions)
    views = []
    for camera in cameras:
        home = folder / camera.name
        home.mkdir(parents=True)
        for f in range(len(motions[0])):
            assert cv2.imwrite(str(home / f"{f:03d}.png"), picture(bodies, poses, f, camera))
        views.append(View(camera, home / "%03d.png"))
    return views


def shot_of(
    views: Sequence[View],
    bodies: Sequence[Body],
    motions: Sequence[Motion],
    keys: Sequence[int],
    settings: Settings | None = None,
    fps: float = 30.0,
) -> Shot:
    """A shot whose key poses are true."""
    people = [
        Performer(f"performer {i}", body, KeyPoses.whole(list(keys), motion[list(keys)]))
        for i, (body, motion) in enumerate(zip(bodies, motions, strict=True))
    ]
    return Shot("synthetic", fps, (0, len(motions[0]) - 1), tuple(views), tuple(people), settings or Settings())
