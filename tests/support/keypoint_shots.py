"""Keypoints whose truth is known: what a detector would see of a moving body."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from kfmocap.core.body import Body, human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats.keypoint_layouts import BODY_25
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.numerics import rotations
from synthetic import look_at

Array = np.ndarray
SIZE = (640, 480)
NAMES = tuple(n for n in BODY_25 if n != "-")


def cameras(count: int = 3) -> list[Camera]:
    """Around a person at the origin, five metres away."""
    angles = np.radians([-90, -20, 50, 160][:count])
    eyes = [(5 * np.cos(a), 5 * np.sin(a), 1.3) for a in angles]
    return [look_at(f"cam{i + 1:02d}", eye, (0, 0, 0.95), SIZE, 560) for i, eye in enumerate(eyes)]


def strolling(body: Body, frames: int, place: Sequence[float] = (0, 0, 0), phase: float = 0.0) -> Motion:
    """A walk of sorts, about a step a second at 30 frames a second."""
    t = np.arange(frames) / 30
    swing = np.sin(2 * np.pi * 0.8 * t + phase)
    turns = np.zeros((frames, len(body), 3))
    for side, sign in (("L", 1.0), ("R", -1.0)):
        turns[:, body.index(f"thigh.{side}"), 0] = 0.45 * sign * swing
        turns[:, body.index(f"shin.{side}"), 0] = -0.4 + 0.3 * sign * swing
        turns[:, body.index(f"upper_arm.{side}")] = np.outer(np.ones(frames), [0, 0, -1.2 * sign])
        turns[:, body.index(f"upper_arm.{side}"), 1] = -0.4 * swing
        turns[:, body.index(f"forearm.{side}"), 0] = 0.6 + 0.2 * sign * swing
    path = body.offsets[0] + np.asarray(place, float) + np.outer(t - t.mean(), [0.1, -0.5, 0])
    path[:, 2] += 0.02 * np.cos(4 * np.pi * 0.8 * t)
    return Motion(path, rotations.exp(turns))


def seen_places(body: Body, motion: Motion, offsets: Array | None = None) -> Array:
    """What a detector means by its keypoints, in the world, shape (F, L, 3)."""
    places = KeypointOffsets.on(body, NAMES)
    if offsets is not None:
        places = KeypointOffsets(places.parts, places.local, offsets)
    return places.world(part_poses(body, motion))


def keypoints_of(
    views: Sequence[Camera], points_world: Array, noise: float = 0.0, seed: int = 0, confidence: float = 1.0
) -> Keypoints:
    """Keypoints of points (F, L, 3), noise in metres at one metre of distance per metre."""
    rng = np.random.default_rng(seed)
    F = len(points_world)
    poses = [camera.poses(0, F) for camera in views]
    R, t = np.stack([R for R, _ in poses]), np.stack([t for _, t in poses])
    x = np.einsum("vfab,flb->vfla", R, points_world) + t[:, :, None]
    rays = x[..., :2] / x[..., 2:]
    rays = rays + noise / x[..., 2:] * rng.normal(size=rays.shape)
    return Keypoints(NAMES, rays, np.full(rays.shape[:3], confidence), R, t)


def write_openpose(folder: Path, camera: Camera, people: Sequence[Array], noise: float = 0.0, first: int = 0) -> None:
    """Write what a detector would of people whose keypoints are at points (F, L, 3), NaN if not found."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(int(camera.name[-2:]))
    for f in range(len(people[0])):
        bodies = []
        for points in people:
            places = camera.project(points[f], f) + rng.normal(0, noise, (len(NAMES), 2))
            pixels = {n: place for n, place in zip(NAMES, places, strict=True) if np.isfinite(place).all()}
            values = [v for n in BODY_25 for v in ((*pixels[n].tolist(), 0.9) if n in pixels else (0.0, 0.0, 0.0))]
            bodies.append({"person_id": [-1], "pose_keypoints_2d": values})
        document = {"version": 1.3, "people": bodies}
        (folder / f"{camera.name}_{first + f:06d}.json").write_text(json.dumps(document))


def triples(pixels: Array, confidence: float = 0.9) -> list[float]:
    """x, y, confidence one after the other."""
    return [v for u, w in pixels for v in (float(u), float(w), confidence)]


def person_with_hands(pixels: Array) -> dict[str, object]:
    """A person as OpenPose writes it, with hands at 42 pixels and the body nowhere in particular."""
    hands = {
        f"hand_{side}_keypoints_2d": triples(part)
        for side, part in zip(("left", "right"), (pixels[:21], pixels[21:]), strict=True)
    }
    return {"person_id": [-1], "pose_keypoints_2d": triples(np.full((25, 2), 50.0)), **hands}


def person(height: float = 1.75) -> Body:
    return human(height)


def joint_errors(body: Body, motion: Motion, truth_body: Body, truth: Motion) -> Array:
    """Distances of the main joints from the true ones, metres, shape (F, 12)."""
    names = [n for n in NAMES if n[1:] in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
    found, true = landmark_positions(body, motion, names), landmark_positions(truth_body, truth, names)
    return np.linalg.norm(found - true, axis=-1)
