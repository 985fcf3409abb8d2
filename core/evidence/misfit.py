"""Misfit: foreground that the model leaves uncovered, and background that it covers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..numerics.arrays import Array, Bools, Ints
from .foreground_images.foreground import SURE_LOG_RATIO, background_share, log_ratio
from .frame_comparison import EvidenceCaches
from .rendering.label_images import render_labels
from .rendering.part_geometry import Geometry
from .view_frames import ViewFrames, views_with_foreground
from .view_work import IN_THIS_THREAD, ViewWork

OWN_REACH, SEARCH_REACH = 0.2, 0.4
"""Distances from the model up to which uncovered foreground counts as the performer's, and up to which a lost limb is
searched for, metres.
"""
OUTSIDE_MARGIN = 0.04
"""Distance from the model from which on foreground cannot be clothes or hair of the part there, metres."""
INSIDE_MARGIN = 0.02
"""Distance within the model's outline from which on pixels count as covered by a part, metres: the model is inexact."""
_STRIDE = 4
_FURNITURE_SHARE = 0.8
"""Share of the frames on which a pixel is covered and shows background from which on something stands in front there:
pictures of a limb where it is right look like background on 0.05 of it."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """Differences between performers and the foreground of V views on F frames.

    Attributes
    ----------
    gaps : ndarray, shape (V, N, F)
        Area of uncovered foreground near each of N performers divided by the length of the model's outline, metres; NaN
        where the view does not see the performer.
    areas : ndarray, shape (V, N, F)
        Area of foreground from `OUTSIDE_MARGIN` to `SEARCH_REACH` from a performer and farther than `OUTSIDE_MARGIN`
        from all others, square metres at the performer's distance.
    visible : ndarray, shape (V, F, P)
        Visible area of each part without a margin along the outline, square metres. Where something stands in front
        that looks like background, nothing is visible.
    background : ndarray, shape (V, F, P)
        Share of that area that shows background, 0 to 1.
    pixels : ndarray, shape (V, F, P)
        Number of pixels from which this share was measured.
    """

    gaps: Array
    areas: Array
    visible: Array
    background: Array
    pixels: Array

    def mean_gaps(self, known: Sequence[NDArray[np.intp]]) -> Array:
        """Mean distance of the performers' outlines from the model's over all views, metres, (N, F).

        The values on frames with known poses, (K,) for each performer, are subtracted: they are due to clothes, shadows
        and bystanders.
        """
        if not len(self.gaps):
            return np.zeros(self.gaps.shape[1:])
        seen = np.isfinite(self.gaps)
        gaps = np.where(seen, self.gaps, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        return np.maximum(beyond_known(gaps, known), 0.0)

    def areas_beside(self, known: Sequence[NDArray[np.intp]]) -> Array:
        """Return the areas (V, N, F) minus those on frames with known poses, as in `mean_gaps`."""
        return np.array([beyond_known(view, known) for view in self.areas]).reshape(self.areas.shape)


def beyond_known(rows: Array, known: Sequence[NDArray[np.intp]]) -> Array:
    """Subtract from rows (N, F) the values on their known frames, interpolated between these."""
    usual = [
        np.interp(np.arange(len(row)), keys, row[keys]) if len(keys) else np.zeros(len(row))
        for row, keys in zip(rows, known, strict=True)
    ]
    return np.asarray(rows - usual)


def measured_misfit(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    *,
    first: int,
    spans: Sequence[slice],
    limb_of: Ints | None = None,
    by: ViewWork = IN_THIS_THREAD,
) -> Misfit:
    """Compare performers with the foreground images of the views that have any.

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
    limb_of : ndarray of int, shape (P,), optional
        Number of the limb of each part, by which things in front are told from limbs that are lost.
    by : ViewWork, optional
    """
    tasks = [(view, (geometry, poses[view.delay], first, spans, limb_of)) for view in views_with_foreground(views)]
    found = list(by.of_each(_view_misfit, tasks, EvidenceCaches()))
    F, P = next(iter(poses.values()))[1].shape[:2]
    shapes = [(len(spans), F), (len(spans), F), (F, P), (F, P), (F, P)]
    return Misfit(
        *(np.stack([own[k] for own in found]) if found else np.zeros((0, *shape)) for k, shape in enumerate(shapes))
    )


def bare_shares(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Mapping[float, Poses],
    *,
    first: int,
    limb_of: Ints,
    by: ViewWork = IN_THIS_THREAD,
) -> Array:
    """Share of the pixels that each part covers in each view with foreground images behind which nothing but background
    lies, (V, F, P): no other limb, no trunk and nobody else. Parameters as for `measured_misfit`.
    """
    tasks = [(view, (geometry, poses[view.delay], first, limb_of)) for view in views_with_foreground(views)]
    found = list(by.of_each(_bare_shares, tasks, EvidenceCaches()))
    return np.array(found).reshape(-1, *next(iter(poses.values()))[1].shape[:2])


def most_explained(
    view: ViewFrames, geometry: Geometry, poses: Poses, performer: int, *, first: int, frames: Sequence[int]
) -> Array:
    """Return the most that a performer could explain of some of F frames of a view, however its limbs turn, shape (n,).

    That is the sum of the positive log likelihood ratios of all pixels within `SEARCH_REACH` of the model, each with
    the likeliest of the colours of the performer's parts.

    Parameters
    ----------
    view : ViewFrames
        With foreground images.
    geometry : Geometry
        The parts of all performers.
    poses : tuple
        World poses of all parts on the F frames.
    performer : int
    first : int
        Shot frame of the first of them.
    frames : sequence of int
        n of them, counted from the first.
    """
    R, T = poses
    camera, own, most = view.camera.subsampled(_STRIDE), geometry.performer == performer, np.zeros(len(frames))
    sound, _ = view.sound(first, len(T))
    for k, f in enumerate(frames):
        if not sound[f]:
            continue
        labels = render_labels(geometry, camera, first + f, R[[f]], T[[f]])
        ratio = log_ratio(view.foreground_at(first + f, 1, _STRIDE)[performer, 0])
        coloured = view.part_colours(first + f, 1, _STRIDE)
        if coloured is not None:
            ratio = ratio + coloured.colours.ratio[own].max(axis=0)[coloured.palette[0]]
        reach = SEARCH_REACH * view.camera.pixels_per_metre(T[f].mean(axis=0), first + f) / _STRIDE
        within = _distance(labels.part[0] >= 0) < reach
        most[k] = _STRIDE**2 * np.maximum(ratio[within], 0).sum(dtype=float)
    return most


def _view_misfit(
    view: ViewFrames, _caches: EvidenceCaches, asked: tuple[Geometry, Poses, int, Sequence[slice], Ints | None]
) -> tuple[Array, ...]:
    """Compute the attributes of `Misfit` for one view; see `measured_misfit` for what is asked."""
    geometry, (R, T), first, spans, limb_of = asked
    P = T.shape[1]
    labels = render_labels(geometry, view.camera.subsampled(_STRIDE), first, R, T)
    scale = view.camera.pixels_per_metre(T.mean(axis=(0, 1)), first) / _STRIDE
    left, top, right, bottom = labels.box()
    margin = int(np.ceil(SEARCH_REACH * scale)) + 1
    window = (
        slice(None),
        slice(max(top - margin, 0), bottom + margin),
        slice(max(left - margin, 0), right + margin),
    )
    part = labels.part[window]
    foreground = view.foreground_at(first, len(T), _STRIDE)
    gaps, areas = np.full((len(spans), len(T)), np.nan), np.zeros((len(spans), len(T)))
    pixels, background = np.zeros((2, len(T), P))
    covering = np.full_like(part, -1)
    # What hangs over the outline of one performer, hair or clothes, lies beside another one.
    nobody = background_share(log_ratio(foreground.max(axis=0)[window]))
    sound, _ = view.sound(first, len(T))
    apart = [_distance(image >= 0) > OUTSIDE_MARGIN * scale for image in part] if len(spans) > 1 else None
    for n, span in enumerate(spans):
        ratio = log_ratio(foreground[n][window])
        shown = np.where(part < 0, np.clip(ratio / SURE_LOG_RATIO, 0, 1), np.float32(0))
        models = (part >= span.start) & (part < span.stop)
        for f in np.flatnonzero(models.any(axis=(1, 2)) & sound):
            beyond = _distance(models[f])
            outline = np.count_nonzero((beyond > 0) & (beyond < 1.2))
            gaps[n, f] = float(shown[f][beyond < OWN_REACH * scale].sum()) / max(outline, 1) / scale
            beside = apart[f] if apart is not None else beyond > OUTSIDE_MARGIN * scale
            areas[n, f] = float(shown[f][beside & (beyond < SEARCH_REACH * scale)].sum()) / scale**2
            within = cv2.distanceTransform(models[f].astype(np.uint8), cv2.DIST_L2, 3) > max(INSIDE_MARGIN * scale, 1.0)
            covering[f][within] = part[f][within]
    if limb_of is not None and view.camera.stands_still:
        covering[:, _furniture(covering, nobody, limb_of)] = -1
    for f in range(len(T)):
        within = covering[f] >= 0
        pixels[f] = np.bincount(covering[f][within], minlength=P)
        background[f] = np.bincount(covering[f][within], nobody[f][within], P)
    return gaps, areas, pixels / scale**2, background / np.maximum(pixels, 1), pixels


def _bare_shares(view: ViewFrames, _caches: EvidenceCaches, asked: tuple[Geometry, Poses, int, Ints]) -> Array:
    """Compute `bare_shares` for one view, (F, P)."""
    geometry, (R, T), first, limb_of = asked
    labels = render_labels(geometry, view.camera.subsampled(_STRIDE), first, R, T)
    bare = np.zeros(T.shape[:2])
    for limb in np.unique(limb_of):
        own = np.flatnonzero(limb_of == limb)
        alone = labels.labels_without(own.tolist()).ravel()[labels.index] < 0
        counts = np.diff(np.concatenate([[0], np.cumsum(alone)])[labels.ends]).reshape(bare.shape)
        bare[:, own] = counts[:, own]
    return bare / np.maximum(np.diff(labels.ends).reshape(bare.shape), 1)


def _furniture(covering: NDArray[Any], nobody: NDArray[np.float32], limb_of: Ints) -> Bools:
    """Return where something stands in front of performers that looks like background, (h, w), by the parts that cover
    pixels on F frames and the share of background there, (F, h, w): two limbs pass, and nothing is seen of either. One
    may be lost.
    """
    covered = covering >= 0
    limbs, seen = np.where(covered, limb_of[covering], -1), np.zeros(covering.shape[1:], int)
    for limb in np.unique(limb_of):
        seen += (limbs == limb).any(axis=0)
    shares = (covered * nobody).sum(axis=0) / np.maximum(covered.sum(axis=0), 1)
    return np.asarray((seen >= 2) & (shares > _FURNITURE_SHARE))


def _distance(mask: NDArray[np.bool_]) -> Array:
    """Distance of every pixel (h, w) from a mask, pixels."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3))
