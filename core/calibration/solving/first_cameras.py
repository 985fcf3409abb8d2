"""First cameras from the wand alone: pairs, a seed, and then one camera after the other along a spanning tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...numerics import rotations
from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import StoppingRule
from ...numerics.robust_kernels import Cauchy
from .assumed_lens import Lens
from .ball_observations import BallObservations
from .bundle import BundleFit, adjust
from .bundle_scene import BundleEvidence, Scene
from .camera_rig import CAMERA_DOF, COEFFICIENTS, FOCAL, K1, SHIFT, TURN, Rig
from .pairwise import Epipolar, Start, epipolar, starts
from .view_links import MIN_LINK_FRAMES, Cancel, Link
from .wand_tracks import Tracks
from .wand_triangulation import WandSighting, sight

_MAX_FRAMES = 120  # largest number used of those that two views share, evenly spaced
_SEEDS = 3  # pairs of cameras that are tried as the start
_SUFFICIENT_AGREEMENT = 0.9
"""Agreement, relative to the best possible, from which no other seed is tried."""
_FIRST_SCALE, _ADJUSTED_SCALE = 10.0, 3.0
"""Scales of the robust loss, in standard deviations, for cameras that are a first guess and for adjusted ones."""
_FEW_STEPS = StoppingRule[Scene](15, relative_gain=1e-2)
_RESECTED = StoppingRule[Scene](relative_gain=1e-3)
_RESECTION_PIXELS = 12.0  # tolerance of a ball's residual while distortion is unknown


@dataclass(frozen=True, eq=False)
class _FilmedWand:
    """The wand as several views show it.

    Attributes
    ----------
    tracks : Tracks
        The wand on common frames.
    lenses : sequence of Lens
        One per view.
    length : float
        Length of the wand, metres.
    cancel : callable
        Called repeatedly; may raise.
    """

    tracks: Tracks
    lenses: Sequence[Lens]
    length: float
    cancel: Cancel

    def by(self, views: Sequence[int]) -> _FilmedWand:
        """Return the wand as only these views show it."""
        return replace(self, tracks=self.tracks.views(views), lenses=[self.lenses[v] for v in views])


def observed(tracks: Tracks, sighting: WandSighting) -> BallObservations:
    """Return the balls that a sighting identifies as the wand's, on the frames where both its ends are known."""
    v, f, end = np.nonzero((sighting.ball >= 0) & sighting.known[None, :, None])
    ball = sighting.ball[v, f, end]
    return BallObservations(v, end, tracks.frames[f].astype(float), tracks.points[v, f, ball], tracks.sigma[v, f, ball])


def first_rig(
    names: Sequence[str],
    tracks: Tracks,
    lenses: Sequence[Lens],
    links: Sequence[Link],
    *,
    length: float,
    cancel: Cancel,
) -> Rig | None:
    """Return cameras with the capture's clock, in the frame of one of them; None if no seed leads to all of them.

    Parameters
    ----------
    names : sequence of str
    tracks : Tracks
        The wand on common frames.
    lenses : sequence of Lens
    links : sequence of Link
    length : float
        Length of the wand, metres.
    cancel : callable
        Called repeatedly; may raise.
    """
    best, most = None, 0.0
    blank = _blank(names, lenses)
    for link in sorted(links, key=lambda link: -link.worth)[:_SEEDS]:
        if link.geometry is None:
            continue
        rig = _grown(blank, _FilmedWand(_thinned(tracks, link), lenses, length, cancel), link, links)
        if rig is None:
            continue
        share = _agreement(rig, tracks, length)
        if share > most:
            best, most = rig, share
        if most > _SUFFICIENT_AGREEMENT * _possible(links):
            break
    return best


def _possible(links: Sequence[Link]) -> float:
    """Return the fraction of the balls that the best rig can explain, from the epipolar geometries."""
    shares = [link.agreeing / (2 * len(link.frames)) for link in links if link.geometry is not None]
    return float(np.median(shares))


def _agreement(rig: Rig, tracks: Tracks, length: float) -> float:
    """Return the fraction of the balls that the rig explains as the wand's, where several views see both ends."""
    tracks = tracks.take(tracks.seen.all(axis=2).sum(axis=0) >= 2)
    ball = sight(rig, tracks, length, noise=1.5).ball
    return float((ball >= 0).sum() / max(tracks.seen.sum(), 1))


def _thinned(tracks: Tracks, link: Link) -> Tracks:
    """Return the tracks on no more frames than needed, both of those that the seed sees and of the others."""
    n = len(tracks.frames)
    seen = np.zeros(n, bool)
    seen[link.frames] = True
    several = tracks.seen.all(axis=2).sum(axis=0) >= 2
    chosen = [
        group[np.linspace(0, len(group) - 1, min(_MAX_FRAMES, len(group))).astype(int)]
        for group in (np.flatnonzero(seen), np.flatnonzero(several & ~seen))
        if len(group)
    ]
    return tracks.take(np.unique(np.concatenate(chosen)))


def _blank(names: Sequence[str], lenses: Sequence[Lens]) -> Rig:
    """Return a rig of cameras whose poses are still unknown."""
    C = len(names)
    focal = np.array([np.median(lens.focals) for lens in lenses])[:, None] * np.ones((C, 2))
    distortions = np.zeros((C, COEFFICIENTS))
    for c, lens in enumerate(lenses):
        if lens.matrix is not None:
            focal[c] = lens.matrix[[0, 1], [0, 1]]
        if lens.distortions is not None:
            distortions[c, : len(lens.distortions)] = lens.distortions
    return Rig(
        names=tuple(names),
        sizes=np.array([lens.size for lens in lenses]),
        R_cam_world=np.tile(np.eye(3), (C, 1, 1)),
        t_cam_world=np.zeros((C, 3)),
        focal=focal,
        centre=np.array([lens.centre for lens in lenses]),
        distortions=distortions,
        offset=np.zeros(C),
        drift=np.zeros(C),
        rate=np.ones(C),
    )


def unknown_lens(lens: Lens) -> Bools:
    """Return which of a camera's unknowns are solved for at first, shape (13,): pose, focal length, k1."""
    free = np.zeros(CAMERA_DOF, bool)
    free[TURN] = free[SHIFT] = True
    free[FOCAL], free[K1] = lens.matrix is None, lens.distortions is None
    return free


def _grown(blank: Rig, filmed: _FilmedWand, seed: Link, links: Sequence[Link]) -> Rig | None:
    """Add all cameras to those of a seed; next is always the one with most frames linked to known cameras."""
    pair = _seeded(blank, filmed, seed)
    if pair is None:
        return None
    rig, known = blank.put(seed.views, pair), list(seed.views)
    while len(known) < len(rig):
        filmed.cancel()
        joining = [link for link in links if sum(v in known for v in link.views) == 1 and link.geometry is not None]
        if not joining:
            return None
        link = max(joining, key=lambda link: link.agreeing)
        new = next(v for v in link.views if v not in known)
        camera = _resected(rig, filmed, link, known, new)
        if camera is None:
            return None
        known.append(new)
        rig = rig.put([new], camera)
        fit = _adjusted(rig.take(known), filmed.by(known))
        if fit is None:
            return None
        rig = rig.put(known, fit.scene.rig)
    return rig


def _seeded(blank: Rig, filmed: _FilmedWand, seed: Link) -> Rig | None:
    """Return the two cameras of a link, with the first at the origin."""
    tracks, (i, j) = filmed.tracks, seed.views
    lenses = filmed.lenses[i], filmed.lenses[j]
    frames = np.flatnonzero(tracks.seen[[i, j]].all(axis=(0, 2)))
    assert seed.geometry is not None
    x, y = (tracks.points[v, frames].reshape(-1, 2) for v in (i, j))
    again = epipolar(x, y, *lenses)
    if again is None:
        return None
    both = again.agreeing.reshape(-1, 2).all(axis=1)
    ends_i, ends_j = tracks.points[i, frames[both]], tracks.points[j, frames[both]]
    guesses = starts(again, (ends_i, ends_j), lenses, filmed.length)
    rigs = [_pair(blank.take([i, j]), guess, again, lenses) for guess in guesses]
    fits = [_adjusted(rig, filmed.by([i, j])) for rig in rigs]
    good = [fit for fit in fits if fit is not None]
    return min(good, key=lambda fit: fit.cost / len(fit.residual) ** 1.5).scene.rig if good else None


def _pair(rig: Rig, guess: Start, geometry: Epipolar, lenses: Sequence[Lens]) -> Rig:
    distortions = rig.distortions.copy()
    focal = rig.focal.copy()
    for c, lens in enumerate(lenses):
        distortions[c, 0] += lens.k1(guess.focal[c], geometry.bend)
        if lens.matrix is None:
            focal[c] = guess.focal[c]
    R, t = np.stack([np.eye(3), guess.R]), np.stack([np.zeros(3), guess.t])
    return replace(rig, focal=focal, distortions=distortions, R_cam_world=R, t_cam_world=t)


def _adjusted(rig: Rig, filmed: _FilmedWand) -> BundleFit | None:
    """Adjust the cameras, first with a loose and then with a tight loss; None if they see the wand nowhere."""
    free = np.stack([unknown_lens(lens) for lens in filmed.lenses])
    fit = None
    for scale, tolerance in ((_FIRST_SCALE, 0.3), (_ADJUSTED_SCALE, 0.15)):
        noise = scale if fit is None else max(scale, fit.noise)
        sighting = sight(rig, filmed.tracks, filmed.length, noise, tolerance)
        if sighting.known.sum() < MIN_LINK_FRAMES // 2:
            return None
        scene = Scene(rig, sighting.wand(filmed.tracks.frames, filmed.length))
        evidence = BundleEvidence(observed(filmed.tracks, sighting))
        fit = adjust(scene, evidence, free, kernel=Cauchy(scale), stopping=_FEW_STEPS, cancel=filmed.cancel)
        rig = fit.scene.rig
    return fit


def _resected(rig: Rig, filmed: _FilmedWand, link: Link, known: Sequence[int], new: int) -> Rig | None:
    """Return one more camera, as a rig of one, by resection from the wand that the others see."""
    assert link.geometry is not None
    tracks, lens = filmed.tracks, filmed.lenses[new]
    sighting = sight(rig.take(known), tracks.views(known), filmed.length, _ADJUSTED_SCALE)
    usable = sighting.known & tracks.seen[new].all(axis=1)
    points, uv = sighting.ends_world[usable].reshape(-1, 3), tracks.points[new, usable].reshape(-1, 2)
    if len(points) < MIN_LINK_FRAMES:
        return None
    straight = lens.straight(uv, link.geometry.bend)
    some = np.linspace(0, len(points) - 1, min(2 * _MAX_FRAMES, len(points))).astype(int)
    tried = (_posed(points[some], straight[some], float(focal)) for focal in lens.focals)
    posed = [found for found in tried if found is not None]
    if not posed:
        return None
    _, focal, R, t = max(posed, key=lambda found: found[0])
    alone = rig.take([new])
    distortions = alone.distortions.copy()
    distortions[0, 0] += lens.k1(focal, link.geometry.bend)
    focals = alone.focal if lens.matrix is not None else np.full((1, 2), focal)
    alone = replace(alone, focal=focals, distortions=distortions, R_cam_world=R[None], t_cam_world=t[None])
    v, f = np.zeros(2 * usable.sum(), int), np.repeat(tracks.frames[usable], 2).astype(float)
    seen = BallObservations(v, np.tile([0, 1], usable.sum()), f, uv, tracks.sigma[new, usable].ravel())
    scene = Scene(alone, sighting.wand(tracks.frames, filmed.length))
    free = unknown_lens(lens)[None]
    for scale in (3 * _FIRST_SCALE, _ADJUSTED_SCALE):
        scene = adjust(
            scene,
            BundleEvidence(seen),
            free,
            kernel=Cauchy(scale),
            stopping=_RESECTED,
            free_wand=False,
            cancel=filmed.cancel,
        ).scene
    return scene.rig


def _posed(points: Array, straight: Array, focal: float) -> tuple[float, float, Array, Array] | None:
    """Return how many points a focal length fits, those that are off counted less; the focal length; and its pose."""
    cv2.setRNGSeed(1)
    K = np.diag([focal, focal, 1.0])
    try:
        found, rvec, t, inliers = cv2.solvePnPRansac(
            points, straight, K, None, None, None, False, 300, _RESECTION_PIXELS, 0.999, None, cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:  # raised where a sample is on one spot, as small movements are with a long focal length
        return None
    if not found or inliers is None:
        return None
    uv = cv2.projectPoints(points, rvec, t, K, None)[0][:, 0]
    miss = np.linalg.norm(uv - straight, axis=1) / _RESECTION_PIXELS
    return float(np.maximum(1 - miss**2, 0).sum()), focal, rotations.exp(rvec.ravel()), t.ravel()
