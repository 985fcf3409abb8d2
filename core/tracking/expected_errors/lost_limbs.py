"""The probability that a part of a limb is lost: that the tracker has it somewhere else than in the footage.

The pixels that a part covers look like the performer where it is right, as on the key frames. Where it is lost, it
covers background in the views in which nothing but background lies behind it; in others it lies in front of the rest of
the body, and nothing shows. A single view leaves more limbs there, so that the sides of limbs and the colours of their
parts, too, are asked whether it is seen. A part that is found covers what looks like background where something stands
in front of it that also stands still, such as furniture or a bystander; other views show that it is found. A lost limb
stays lost for a while, and a hidden one hidden, so the states found, hidden in one of the views, and lost form a hidden
Markov chain, whose probabilities are computed given all frames.
"""

from __future__ import annotations

import numpy as np
from scipy.special import betaln

from ...body import Body
from ...body.kinematics import Poses
from ...body.limbs import limbs
from ...body.tip_landmarks import tip_landmarks
from ...evidence.misfit import Misfit
from ...keypoints.keypoint_factor import KeypointFactor
from ...numerics.arrays import Array, Bools, Ints
from ...numerics.likeliest_path import state_probabilities

LOSS_PROBABILITY, RECOVERY_PROBABILITY = 0.002, 0.1
"""Probabilities per frame that a part that is found gets lost, and that a lost or hidden one is found again."""
HIDING_PROBABILITY = 0.0002
"""Probability per frame and view that a part that is found passes behind something that looks like the background. It
is a tenth of the probability that it gets lost: what one view shows as background counts as lost until another view has
seen the part beside the body on two frames."""
PATCH_SIDE = 0.05
"""Side of a square on the body whose pixels count as one observation, metres; of somebody far away every pixel does."""
FRAMES_PER_OBSERVATION = 2.0
"""Number of frames in a row that count as one observation."""
PRIOR_BACKGROUND_SHARE = 0.05
"""Prior mean of the share of a part's pixels that look like background though the part is right; it weighs as much as
one observation."""
SHARE_MARGIN = 0.02
"""Least distance of this share from 0 and 1."""
SHARE_PRECISION = 20.0
"""How little this share varies, as a number of observations (precision of a beta distribution)."""
REVEAL_PROBABILITY = 0.9
"""Probability that a view reveals that a part is lost, where nothing but background lies behind it. Where the rest of
the body does, it is one minus this."""


def lost_probabilities(
    body: Body,
    misfit: Misfit,
    span: slice,
    *,
    held: Bools,
    keys: Ints,
    bare: Array,
    support: Array | None,
    whole: Array | float = 0.0,
) -> Array:
    """Probability that each part of a performer is lost, shape (F, P).

    For parts of the trunk it is that of the whole body, which can be lost only where some limb is by itself: what a
    body explains less may also be due to light and shade. A part of a limb is at least as probably lost as the one that
    it hangs on.

    Parameters
    ----------
    body : Body
    misfit : Misfit
    span : slice
        The performer's parts in it.
    held : ndarray of bool, shape (F, P)
        Where a part is known to be found: a key pose fixes it, or keypoints confirm it.
    keys : ndarray of int, shape (K,)
        Frames with a key pose of the whole body, which show the share of each part that looks like background though it
        is right. Without any, it is the median over all frames.
    bare : ndarray, shape (V, F, P)
        See `core.evidence.misfit.bare_shares`.
    support : ndarray, shape (F, P) or None
        Log likelihood ratio of the images with each part against without it (`limb_support.support_of_parts`).
    whole : ndarray, shape (F,), or float
        Probability that the whole body is lost, if some limb is, see `lost_body.lost_body_probabilities`.
    """
    visible, background = misfit.visible[..., span], misfit.background[..., span]
    pieces = np.minimum(visible / PATCH_SIDE**2, misfit.pixels[..., span])
    usual = _usual_background(background, pieces, keys)
    any_share = _log_odds(background, pieces, usual)
    revealed = REVEAL_PROBABILITY * bare[..., span] + (1 - REVEAL_PROBABILITY) * (1 - bare[..., span])
    each = np.logaddexp(np.log(1 - revealed), np.log(revealed) + any_share)
    doubt, hidden = each.sum(axis=0) / FRAMES_PER_OBSERVATION, any_share / FRAMES_PER_OBSERVATION
    # Of a lost part the images say as much as if nothing were there.
    unseen = None if support is None else -_outward(body, support) / FRAMES_PER_OBSERVATION
    lost = np.zeros(held.shape)
    for chain in limbs(body):
        sure = np.ones(len(lost))
        for part in chain:
            free = np.where(held[:, part], -np.inf, 0.0)
            sure = sure * (1 - chain_probabilities(doubt[:, part] + free, hidden[..., part]))
            if unseen is not None:
                sure = sure * (1 - chain_probabilities(unseen[:, part] + free))
            lost[:, part] = 1 - sure
    return np.asarray(1 - (1 - lost) * (1 - whole * lost.max(axis=1))[:, None])


def confirmed_parts(body: Body, keypoints: KeypointFactor, poses: Poses) -> Bools:
    """Return which parts have keypoints near their tips in two views, or in the only one, shape (F, P)."""
    views = keypoints.views_near(poses) >= min(2, len(keypoints.keypoints.rays))
    confirmed = np.zeros((len(views), len(body)), bool)
    for part, name in tip_landmarks(body).items():
        if name in keypoints.keypoints.names:
            confirmed[:, part] = views[:, keypoints.keypoints.names.index(name)]
    return confirmed


def lost_lengths(body: Body, lost: Array) -> Array:
    """Expected distance of each part's tip from its true position if it is lost, metres, shape (F, P).

    It is the length of the limb from the first part that is lost to the tip: of an arm that is found, a hand can only
    be off by its own length. Of a body that is lost, it is the length from the root to the tip, and at least that of
    the trunk, as it may be turned about its head or its feet.

    Parameters
    ----------
    lost : ndarray, shape (F, P)
        Probability that each part is lost, see `lost_probabilities`.
    """
    lengths = np.array([float(np.linalg.norm(part.tail_world - part.head_world)) for part in body.parts])
    whole, far = lost[:, 0], _lengths_of_body(body, lengths)
    found = np.where(whole[:, None] > 0, far, 0.0)
    for chain in limbs(body):
        first = np.diff(lost[:, chain], axis=1, prepend=whole[:, None])
        for i, part in enumerate(chain):
            to_tip = np.cumsum(lengths[chain[i::-1]])[::-1]
            expected = whole * far[part] + first[:, : i + 1] @ to_tip
            found[:, part] = expected / np.maximum(lost[:, part], 1e-12)
    return found


def _lengths_of_body(body: Body, lengths: Array) -> Array:
    """Return the lengths from the root to the tips of all parts, at least that of the trunk, metres, (P,)."""
    from_root = lengths.copy()
    for part, parent in enumerate(body.parents):
        if parent >= 0:
            from_root[part] += from_root[parent]
    trunk = np.setdiff1d(np.arange(len(body)), [part for chain in limbs(body) for part in chain])
    return np.maximum(from_root, from_root[trunk].max())


def _outward(body: Body, values: Array) -> Array:
    """Sums of values (F, P) over each part of a limb and those beyond it, (F, P)."""
    total = values.copy()
    for chain in limbs(body):
        total[:, chain] = np.cumsum(values[:, chain[::-1]], axis=1)[:, ::-1]
    return total


def _usual_background(background: Array, pieces: Array, keys: Ints) -> Array:
    """Expected share of each part that looks like background where it is right, (V, F, P)."""
    if not len(keys):
        usual = np.where(pieces > 0, background, np.nan)
        seen = (pieces > 0).any(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            usual = np.nanmedian(np.where(seen, usual, 0.0), axis=1, keepdims=True)
        return np.broadcast_to(np.maximum(usual, PRIOR_BACKGROUND_SHARE), background.shape)
    known = (PRIOR_BACKGROUND_SHARE + background[:, keys] * pieces[:, keys]) / (1 + pieces[:, keys])
    frames = np.arange(background.shape[1])
    after = np.clip(np.searchsorted(keys, frames), 1, max(len(keys) - 1, 1))
    a, b = after - 1, np.minimum(after, len(keys) - 1)
    share = np.clip((frames - keys[a]) / np.maximum(keys[b] - keys[a], 1), 0, 1)[:, None]
    return np.asarray(known[:, a] * (1 - share) + known[:, b] * share)


def _log_odds(background: Array, pieces: Array, usual: Array) -> Array:
    """Log likelihood ratio of the share of background on each part in each view, (V, F, P): if every share is equally
    likely, against a part that is seen where the model has it.
    """
    hits, usual = background * pieces, np.clip(usual, SHARE_MARGIN, 1 - SHARE_MARGIN)
    a, b = usual * SHARE_PRECISION, (1 - usual) * SHARE_PRECISION
    seen = betaln(hits + a, pieces - hits + b) - betaln(a, b)
    return np.asarray(betaln(hits + 1, pieces - hits + 1) - seen)


def chain_probabilities(if_lost: Array, if_hidden: Array | None = None) -> Array:
    """Probability of the lost state on each of F frames given all of them, by the forward-backward algorithm.

    Parameters
    ----------
    if_lost : ndarray, shape (F,)
        Log likelihood ratio of what all views show if lost, against found; minus infinity where it is known to be
        found.
    if_hidden : ndarray, shape (V, F), optional
        The same of what a view shows of a part that is hidden in it, against one that is found. Other views show a
        hidden part as they show one that is found.
    """
    V, F = (0, len(if_lost)) if if_hidden is None else if_hidden.shape
    found, lost, hidden = 0, 1, slice(2, None)
    costs = np.zeros((2 + V, F))
    costs[lost] = -if_lost
    if if_hidden is not None:
        costs[hidden] = -if_hidden
    change = np.diag(np.full(2 + V, 1 - RECOVERY_PROBABILITY))
    change[found] = [1 - LOSS_PROBABILITY - V * HIDING_PROBABILITY, LOSS_PROBABILITY, *[HIDING_PROBABILITY] * V]
    change[1:, found] = RECOVERY_PROBABILITY
    begin = change[found] / RECOVERY_PROBABILITY  # as it is in the long run, to the first order
    begin[found] = 1.0
    costs[:, 0] -= np.log(begin)
    with np.errstate(divide="ignore"):
        step = -np.log(change)
    return state_probabilities(costs, lambda _: step)[0][lost]
