"""Misfit: what the pictures show of a performer and the model leaves uncovered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array
from .foreground import log_ratio
from .label_images import Geometry, render_labels
from .view_frames import ViewFrames, views_with_foreground

NEAR = 0.2
"""How far from the model uncovered foreground counts as the performer's, metres."""
FAR = 0.4
"""How far from the model a limb that it has elsewhere is looked for, metres."""
BESIDE = 0.04
"""How far from the model foreground is no longer the clothes or the hair of what is there, metres."""
SURE = 2.0
"""Log likelihood ratio at which a pixel counts as foreground in full."""
_STRIDE = 4


def uncovered_gaps(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    *,
    first: int,
    spans: Sequence[slice],
    known: Sequence[NDArray[np.intp]],
    threads: int = 1,
) -> Array:
    """How far the performers' outlines lie outside of the model's on average, metres.

    It is the uncovered foreground near the model over the length of the model's outline, less what there is of it on
    the frames whose poses are known: clothes, shadows and bystanders that the model does not have.

    Parameters
    ----------
    views : sequence of ViewFrames
        Those without foreground images are left out.
    geometry : Geometry
        The parts of all performers.
    poses : mapping of float to tuple
        World poses of all parts on F frames, by the delay of the views that show them.
    first : int
        Shot frame of the first of them.
    spans : sequence of slice
        The parts of each of N performers.
    known : sequence of ndarray of int, shape (K,)
        Of each performer: the frames, of the F, whose poses are known.
    threads : int

    Returns
    -------
    ndarray, shape (N, F)
    """
    found = [gaps for gaps, _ in _of_views(views, geometry, poses, first=first, spans=spans, threads=threads)]
    if not found:
        return np.zeros((len(spans), len(next(iter(poses.values()))[0])))
    gaps = np.nansum(found, axis=0) / np.maximum(np.isfinite(found).sum(axis=0), 1)
    return np.maximum(_beyond_known(gaps, known), 0.0)


def uncovered_areas(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    *,
    first: int,
    spans: Sequence[slice],
    known: Sequence[NDArray[np.intp]],
    threads: int = 1,
) -> Array:
    """How much foreground lies beside the performers, from `BESIDE` to `FAR` from the model, square metres at their
    distance; less what there is of it on the frames whose poses are known.

    Parameters are those of `uncovered_gaps`.

    Returns
    -------
    ndarray, shape (V, N, F)
        Of the views with foreground images.
    """
    found = [areas for _, areas in _of_views(views, geometry, poses, first=first, spans=spans, threads=threads)]
    areas = [_beyond_known(view, known) for view in found]
    return np.stack(areas) if areas else np.zeros((0, len(spans), len(next(iter(poses.values()))[0])))


def _beyond_known(rows: Array, known: Sequence[NDArray[np.intp]]) -> Array:
    """Rows (N, F) of the performers less what they are between their known frames."""
    usual = [
        np.interp(np.arange(len(row)), keys, row[keys]) if len(keys) else np.zeros(len(row))
        for row, keys in zip(rows, known, strict=True)
    ]
    return np.asarray(rows - usual)


def _of_views(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    *,
    first: int,
    spans: Sequence[slice],
    threads: int,
) -> list[tuple[Array, Array]]:
    """Gaps and areas of every view with foreground images, see `_view_misfit`."""
    misfit_of = partial(_view_misfit, geometry=geometry, first=first, spans=spans)
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda view: misfit_of(view, poses=poses[view.delay]), views_with_foreground(views)))


def _view_misfit(
    view: ViewFrames, geometry: Geometry, poses: Poses, first: int, spans: Sequence[slice]
) -> tuple[Array, Array]:
    """One view's gaps (N, F), metres, NaN where it does not see a performer, and areas (N, F), square metres."""
    R, T = poses
    labels = render_labels(geometry, view.camera.subsampled(_STRIDE), first, R, T)
    scale = view.pixels_per_metre(T.mean(axis=(0, 1)), first) / _STRIDE
    left, top, right, bottom = labels.box()
    margin = int(np.ceil(FAR * scale)) + 1
    window = (
        slice(None),
        slice(max(top - margin, 0), bottom + margin),
        slice(max(left - margin, 0), right + margin),
    )
    part = labels.part[window]
    foreground = view.foreground_at(first, len(T))[..., ::_STRIDE, ::_STRIDE]
    gaps, areas = np.full((len(spans), len(T)), np.nan), np.zeros((len(spans), len(T)))
    for n, span in enumerate(spans):
        ratio = log_ratio(foreground[n][window])
        shown = np.where(part < 0, np.clip(ratio / SURE, 0, 1), np.float32(0))
        models = (part >= span.start) & (part < span.stop)
        for f in np.flatnonzero(models.any(axis=(1, 2))):
            beyond = cv2.distanceTransform((~models[f]).astype(np.uint8), cv2.DIST_L2, 3)
            outline = np.count_nonzero((beyond > 0) & (beyond < 1.2))
            gaps[n, f] = float(shown[f][beyond < NEAR * scale].sum()) / max(outline, 1) / scale
            areas[n, f] = float(shown[f][(beyond > BESIDE * scale) & (beyond < FAR * scale)].sum()) / scale**2
    return gaps, areas
