"""What key frames show of the performers: their colours against the background, and the shapes of their parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from ...body import Body
from ...body.kinematics import Poses, scene_poses
from ...body.motion import Motion
from ...body.time_shift import poses_after
from ...evidence.foreground_images.foreground import EDGE_HALO, performer_foregrounds
from ...evidence.foreground_images.known_pixels import CLOTHES_MARGIN, KnownPixels
from ...evidence.foreground_images.masks import interior, outside
from ...evidence.foreground_images.part_colours import PartColours
from ...evidence.part_shapes import FittedShape, fitted_shape
from ...evidence.rendering.label_images import render_labels
from ...evidence.rendering.part_geometry import Geometry
from ...evidence.view_frames import ViewFrames, views_with_foreground
from ...evidence.view_work import IN_THIS_THREAD, ViewWork
from ...numerics.arrays import Array, Bools
from ...runtime.processes.shared_arrays import each_row
from ...shot.segments import PosedFrames
from .picture_store import FOREGROUND, GREY, PALETTE, PictureStore
from .reader import ColourFrames

KEY_POSE_REACH = 0.1
"""Distance by which a performer may differ from its nearest key poses, metres; it grows by `REACH_GROWTH` per second of
the time between."""
REACH_GROWTH = 0.5
"""Metres per second."""
MAX_REACH = 1.0
"""Upper limit of that distance, metres."""


def grey_frames(frames: ColourFrames, store: PictureStore | None) -> ViewFrames:
    """Convert frames to grey levels, for solvers that use image gradients alone; kept in a store, by default in
    memory.
    """
    pictures = (np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8) for image in each_row(frames.colour))
    grey = (store or PictureStore()).kept(GREY, pictures, len(frames.colour))
    return ViewFrames(frames.camera, grey, frames.first, delay=frames.delay, torn=frames.torn, damaged=frames.damaged)


def frames_with_foreground(
    frames: ColourFrames,
    bodies: Sequence[Body],
    shown: Sequence[Motion],
    keys: PosedFrames,
    *,
    fps: float,
    store: PictureStore | None = None,
) -> ViewFrames:
    """Convert frames to grey levels and foreground images of each performer, learned on the frames with known poses.

    On a frame with a known pose of some performers only, the others are known roughly: pixels that may show them are
    not learned from.

    Parameters
    ----------
    frames : ColourFrames
        Consecutive frames of a view.
    bodies : sequence of Body
    shown : sequence of Motion
        K poses per performer: those that the view shows on the key frames.
    keys : PosedFrames
        Shot frames, among these, that show performers in known poses.
    fps : float
    store : PictureStore, optional
        Where the pictures are kept; by default in memory.

    Returns
    -------
    ViewFrames
        Without foreground images where the view sees nobody on the key frames, or there are none.
    """
    store = store or PictureStore()
    view = grey_frames(frames, store)
    if frames.damaged is not None:
        sound = ~frames.damaged[keys.frames - frames.first]
        keys, shown = keys.where(sound), [motion[sound] for motion in shown]
    if not len(keys.frames):
        return view
    poses = scene_poses(bodies, shown)
    margins = np.minimum(KEY_POSE_REACH + REACH_GROWTH * keys.apart / fps, MAX_REACH)
    geometry = Geometry.of(bodies)
    known = known_pixels(view, geometry, poses, keys, margins)
    if not any(mask.any() for shown in known.shown for mask in shown.values()):
        return view
    images = performer_foregrounds(frames.colour, known, view.camera.stands_still)
    foreground = np.moveaxis(store.kept(FOREGROUND, images, len(frames.colour)), 1, 0)
    view = replace(view, foreground=foreground, halo=EDGE_HALO)
    colours = PartColours.learned(
        frames.colour, known.parts, geometry.performer, parts_apart(bodies), known.pixels_per_metre
    )
    if colours is None:
        return view
    palette = store.kept(PALETTE, colours.images(frames.colour), len(frames.colour))
    return replace(view, colours=colours, palette=palette)


def parts_apart(bodies: Sequence[Body]) -> Bools:
    """Return which pairs of all performers' parts belong to one body and do not touch, shape (P, P)."""
    sizes = [len(body) for body in bodies]
    apart = np.zeros((sum(sizes), sum(sizes)), bool)
    for body, end in zip(bodies, np.cumsum(sizes), strict=True):
        own = slice(end - len(body), end)
        apart[own, own] = ~np.eye(len(body), dtype=bool)
        for part, parent in enumerate(body.parents):
            if parent >= 0:
                apart[own, own][[part, parent], [parent, part]] = False
    return apart


def known_pixels(view: ViewFrames, geometry: Geometry, poses: Poses, keys: PosedFrames, margins: Array) -> KnownPixels:
    """Find which pixels of K frames with known poses surely show a performer, or the background.

    Parameters
    ----------
    view : ViewFrames
    geometry : Geometry
    poses : tuple of ndarray, shapes (K, P, 3, 3) and (K, P, 3)
    keys : PosedFrames
    margins : ndarray, shape (K, M)
        How far performers that are not posed may be from these poses, metres.
    """
    R, T = poses
    camera, M = view.camera.at(keys.frames.tolist()), keys.posed.shape[1]
    labels = render_labels(geometry, camera, 0, R, T).part
    scale = view.camera.pixels_per_metre(T[0].mean(axis=0), int(keys.frames[0]))
    unsure = np.zeros(labels.shape, bool)
    for m in np.flatnonzero(~keys.posed.all(axis=0)):
        (loose,), own = np.nonzero(~keys.posed[:, m]), np.flatnonzero(geometry.performer == m)
        alone = view.camera.at(keys.frames[loose].tolist())
        roughly = render_labels(
            geometry.subset(own.tolist()), alone, 0, R[np.ix_(loose, own)], T[np.ix_(loose, own)]
        ).part
        for k, image in zip(loose, roughly, strict=True):
            unsure[k] |= cv2.distanceTransform((image < 0).astype(np.uint8), cv2.DIST_L2, 3) < scale * margins[k, m]
    shown: list[dict[int, Bools]] = [{} for _ in range(M)]
    behind, parts = {}, {}
    for k, row in enumerate((keys.frames - view.first).tolist()):
        behind[row] = outside(labels[k] >= 0, CLOTHES_MARGIN * scale) & ~unsure[k]
        whose = np.where(labels[k] >= 0, geometry.performer[labels[k]], -1)
        parts[row] = np.where(np.isin(whose, np.flatnonzero(keys.posed[k])) & ~unsure[k], labels[k], np.int16(-1))
        for m in np.flatnonzero(keys.posed[k]):
            shown[m][row] = interior(whose == m) & ~unsure[k]
    return KnownPixels(tuple(shown), behind, scale, parts)


def key_frame_shape(
    views: Sequence[ViewFrames],
    bodies: Sequence[Body],
    motions: Sequence[Motion],
    keys: PosedFrames,
    footage_offset: float,
    *,
    by: ViewWork = IN_THIS_THREAD,
) -> FittedShape | None:
    """Fit the shapes of all performers' parts to the frames with known poses; None if no view has foreground images.

    Parameters as in `frames_with_foreground`, but for motions with poses on every frame of the shot.
    """
    seeing = views_with_foreground(views)
    if not seeing:
        return None
    shown = {d: poses_after(motions, d - footage_offset, keys.frames) for d in {view.delay for view in seeing}}
    poses = {d: scene_poses(bodies, there) for d, there in shown.items()}
    geometry = Geometry.of(bodies)
    return fitted_shape(seeing, geometry, poses, keys.frames.tolist(), keys.posed[:, geometry.performer], by=by)
