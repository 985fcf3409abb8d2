#!/usr/bin/env python3
"""Render the benchmark's shots of made people, with exact truth and a detector's keypoints; needs no Blender.

    .venv/bin/python tools/render_benchmark.py --out build/shots [bow front_kick]

Each shot gets a folder with its footage as pictures, calibration.toml, landmarks.trc, shot.toml and, with keypoints,
shot_keypoints.toml. Shots that are there already are not rendered again. `--preview 0 20` writes PNG pictures of those
frames instead, with the joints marked.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from kfmocap.core.body import Body
from numpy.typing import NDArray
from render.benchmark_shots import PLANS, ShotPlan, is_current, write_description
from render.chosen_shots import render_chosen
from render.drawing import linear
from render.painted_scene import SUBPIXELS, Exposure, PaintedView, box, exposures, joined
from render.people import skin_at, true_landmarks

WOOD = linear([0.28, 0.38, 0.48])
JPEG_QUALITY = 90


def pictures(
    plan: ShotPlan, body: Body, frames: Sequence[int]
) -> Iterator[tuple[int, int, NDArray[np.uint8], NDArray[np.bool_]]]:
    """Render frames; yields the view's number, the frame, its picture, and which landmarks are seen in it (L,)."""
    figure = plan.person.figure(body, plan.voxel)
    colours = linear(figure.colours[:, ::-1])
    furniture = joined([box(*corners, WOOD) for corners in plan.boxes]) if plan.boxes else None
    views = [PaintedView(camera, furniture) for camera in plan.cameras]
    truth = true_landmarks(body, plan.movement.motion(body, plan.seconds))
    own = figure.weights[figure.triangles].sum(axis=1).argmax(axis=1)
    parts = body.landmark_arrays(list(body.landmarks))[0]
    near = (np.eye(len(body)) + body_links(body)) > 0
    for frame in frames:
        skins = skin_at(plan.person, figure, plan.movement, plan.exposed(frame))
        for v, exposure in enumerate(exposures(views, skins, figure.triangles, colours)):
            rng = np.random.default_rng([frame, v, *plan.name.encode()])
            seen = seen_landmarks(plan.cameras[v].project(truth[frame]), exposure, own, near[parts])
            yield v, frame, plan.sensor.recorded(exposure.light, rng), seen


def body_links(body: Body) -> NDArray[np.float64]:
    """1 where a part is another's parent or child, shape (P, P)."""
    links = np.zeros((len(body), len(body)))
    for i, p in enumerate(body.parents):
        if p >= 0:
            links[i, p] = links[p, i] = 1
    return links


def seen_landmarks(
    uv: NDArray[np.float64], exposure: Exposure, own: NDArray[np.int64], near: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether what is seen where a landmark is belongs to its part or a neighbour, shape (L,).

    Parameters
    ----------
    uv : ndarray, shape (L, 2)
        Pixels of the landmarks.
    exposure : Exposure
    own : ndarray of int, shape (N,)
        The part of each of the figure's triangles.
    near : ndarray of bool, shape (L, P)
        The parts that may be seen there.
    """
    rows, columns = exposure.window
    places = ((uv - [columns.start, rows.start] + 0.5) * SUBPIXELS).astype(int)
    seen = np.zeros(len(uv), bool)
    for k, (column, row) in enumerate(places):
        if 0 <= row < exposure.ids.shape[0] and 0 <= column < exposure.ids.shape[1]:
            number = exposure.ids[row, column] - 1
            # Landmarks on the surface may lie just beside the outline.
            seen[k] = number < 0 or (number < len(own) and near[k, own[number]])
    return seen


def render_shot(plan: ShotPlan, out: Path) -> None:
    """Render a shot into a folder of its name, unless it is there."""
    folder = out / plan.name
    if is_current(plan, folder):
        return
    body = plan.person.body()
    seen = np.zeros((len(plan.cameras), plan.frames, len(body.landmarks)), bool)
    with tempfile.TemporaryDirectory(dir=out, prefix=f".{plan.name}-") as scratch:
        part = Path(scratch) / plan.name
        for camera in plan.cameras:
            (part / camera.name).mkdir(parents=True)
        for v, frame, image, visible in pictures(plan, body, range(plan.frames)):
            seen[v, frame] = visible
            path = part / plan.cameras[v].name / f"{frame:04d}.jpg"
            if not cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
                raise OSError(f"{path} cannot be written")
        write_description(plan, body, seen, part)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(part, folder)


def preview(plan: ShotPlan, frames: Sequence[int], out: Path) -> None:
    """Write pictures of some frames with the joints marked: green where seen, red where hidden."""
    body = plan.person.body()
    truth = true_landmarks(body, plan.movement.motion(body, plan.seconds))
    for v, frame, image, seen in pictures(plan, body, frames):
        camera = plan.cameras[v]
        for (x, y), visible in zip(camera.project(truth[frame]), seen, strict=True):
            colour = (0, 255, 0) if visible else (0, 0, 255)
            cv2.circle(image, (round(x * 16), round(y * 16)), 32, colour, 1, cv2.LINE_AA, 4)
        cv2.imwrite(str(out / f"{plan.name}_{camera.name}_{frame:04d}.png"), image)


def main() -> None:
    """Render shots, or previews of some frames."""
    render_chosen(
        __doc__,
        PLANS,
        lambda name, out: render_shot(PLANS[name], out),
        lambda name, frames, out: preview(PLANS[name], frames, out),
    )


if __name__ == "__main__":
    main()
