"""Solving for cameras from a capture of an L-frame and a wand of known measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..capture.capture import Capture, CaptureView
from ..errors import CaptureError
from ..numerics.arrays import Array, Bools
from ..numerics.least_squares import StoppingRule
from ..numerics.robust_kernels import Cauchy
from ..runtime.progress import Progress, report_progress
from . import diagnosis
from .calibration_result import CalibrationResult
from .findings import Finding
from .floor import with_wand_on_floor
from .lframe.lframe_matching import lframe_by_all_views, of_another_size
from .lframe.lframe_pose import LFramePose, check_lframe, check_size, moved_since, place_lframe, resting
from .performer.performer_floor import on_performers_floor
from .quality import measured_lengths
from .solving import lens_selection
from .solving.assumed_lens import Lens
from .solving.ball_observations import BallObservations
from .solving.bundle import NEARLY_CONVERGED, adjust, covariance, variance_inflation
from .solving.bundle_scene import BundleEvidence, Scene
from .solving.camera_rig import DRIFT, OFFSET, Rig
from .solving.first_cameras import first_rig, unknown_lens
from .solving.pairwise import FOCAL_GRID
from .solving.synchrony import Synchrony, find_synchrony, with_capture_clock
from .solving.view_links import MIN_LINK_FRAMES, crossed_views, find_links
from .solving.wand_motion import Wand
from .solving.wand_triangulation import sight
from .wand_matching import labelled

FOCAL_SIGMA = 0.1
"""Standard deviation of a given focal length, relative."""
_EXACT_SIGMA = 1e-6
"""Standard deviation of the L-frame's measures in the covariance, metres: they define the world exactly."""
_MAX_ROUNDS = 4
"""Largest number of rounds of adjusting the cameras and selecting the wand's balls again."""
_CONVERGED_CHANGE = 0.01
"""Relative change of the number of balls, and of their noise, below which these rounds end."""
_ROUGHLY, _EXACTLY = StoppingRule[Scene](relative_gain=1e-4), StoppingRule[Scene](relative_gain=1e-9)
"""When an adjustment ends while balls are still selected again, and the last one."""
_ROBUST_SCALE = 4.0
"""Scale of the robust loss, in standard deviations, while there may still be wrong balls."""
_MIN_NOISE = 0.2  # lower limit, as a multiple of sigma: balls are hardly ever much better than stated
_HELD_OUT, _HELD_OUT_RUN = 10, 10
"""One in this many runs of this many frames is held out; runs, because errors of neighbouring frames are correlated."""


def solve_capture(capture: Capture, progress: Progress | None = None, *, drift: bool = False) -> CalibrationResult:
    """Solve for cameras from an L-frame and a wand.

    Parameters
    ----------
    capture : Capture
    progress : callable, optional
    drift : bool
        Whether clocks of cameras whose offset is estimated may also run at different speeds.

    Raises
    ------
    CaptureError
        The capture does not determine the cameras; the error names the problem and what to do.
    CancelledError
        `progress` returned False.
    """
    steps = _ReportedSteps(progress)
    diagnosis.check_capture(capture)
    steps.next("offsets", 0.0)
    synchrony = find_synchrony(capture)
    tracks = synchrony.tracks()
    known = [_lens(view) for view in capture.views]
    steps.next("pairs", 0.1)
    links = find_links(tracks, known, steps.check)
    names = [view.camera for view in capture.views]
    diagnosis.check_links(names, links, tracks)
    synchrony = synchrony.with_ends_exchanged(crossed_views(links))
    steps.next("first cameras", 0.15)
    start = first_rig(names, synchrony.tracks(), known, links, length=capture.wand_length, cancel=steps.check)
    if start is None:
        raise diagnosis.unsolved(names, links).error()
    start = replace(start, offset=synchrony.offset, rate=synchrony.rate)
    free = np.stack([unknown_lens(lens) for lens in known])
    free[:, OFFSET] = synchrony.estimated
    free[:, DRIFT] = synchrony.estimated & drift
    steps.next("wand", 0.4)
    draft = _polished(start, capture, synchrony, free, steps)
    if draft is None:
        raise diagnosis.unsolved(names, links).error()
    diagnosis.check_solution(names, draft.used, draft.scene.wand)
    steps.next("L-frame", 0.6)
    return _finished(draft, capture, synchrony, free, known=known, steps=steps)


class _ReportedSteps:
    """Reports progress, and raises a CancelledError if the caller has cancelled."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress, self._what, self._fraction = progress, "", 0.0

    def next(self, what: str, fraction: float) -> None:
        self._what, self._fraction = what, fraction
        self.check()

    def check(self) -> None:
        report_progress(self._progress, self._what, self._fraction)


def _lens(view: CaptureView) -> Lens:
    """Return what is known about a camera, and the focal lengths to try."""
    matrix = None if view.matrix is None else np.asarray(view.matrix, float)
    if matrix is not None:
        focals = np.array([matrix[0, 0]])
    elif view.focal is not None:
        focals = view.focal * np.array([0.9, 1.0, 1.1])
    else:
        focals = FOCAL_GRID * max(view.size)
    return Lens(view.size, focals, matrix, None if view.distortions is None else np.asarray(view.distortions, float))


@dataclass(frozen=True, eq=False)
class _Draft:
    """Cameras, the wand, and the balls identified as the wand's."""

    scene: Scene
    seen: BallObservations
    used: Array
    noise: float


def _polished(rig: Rig, capture: Capture, synchrony: Synchrony, free: Bools, steps: _ReportedSteps) -> _Draft | None:
    """Adjust cameras on all frames and select the wand's balls, in turn; None if no wand is seen."""
    noise = 3.0
    draft: _Draft | None = None
    for _ in range(_MAX_ROUNDS):
        before = draft
        wand = _sighted(rig, synchrony, capture.wand_length, noise)
        if len(wand) < MIN_LINK_FRAMES:
            return None
        scene = Scene(rig, wand)
        noise = max(noise if draft is None else draft.noise, 1.0)
        for _ in range(2):
            seen, used = labelled(scene, capture.views, noise)
            evidence = _evidence(capture, seen, synchrony)
            kernel = Cauchy(_ROBUST_SCALE * noise)
            fit = adjust(scene, evidence, free, kernel=kernel, stopping=_ROUGHLY, cancel=steps.check)
            scene, noise = fit.scene, max(fit.noise, _MIN_NOISE)
        draft = _Draft(scene, seen, used, noise)
        rig = scene.rig
        if (
            before is not None
            and abs(len(seen) / len(before.seen) - 1) + abs(noise / before.noise - 1) < _CONVERGED_CHANGE
        ):
            break
    return draft


def _sighted(rig: Rig, synchrony: Synchrony, length: float, noise: float) -> Wand:
    """Triangulate the wand on the capture's frames."""
    tracks = synchrony.tracks(rig)
    found = sight(with_capture_clock(rig), tracks, length, max(noise, 1.0))
    return found.wand(tracks.frames, length, single=not synchrony.needs_interpolation)


def _evidence(capture: Capture, seen: BallObservations, synchrony: Synchrony) -> BundleEvidence:
    focal = np.array([np.nan if v.focal is None or v.matrix is not None else v.focal for v in capture.views])
    return BundleEvidence(seen, focal=focal, focal_sigma=FOCAL_SIGMA, smooth=synchrony.needs_interpolation)


@dataclass(frozen=True, eq=False)
class _FloorCapture:
    """A capture with an L-frame, real or substituted, and the draft in its scale.

    Attributes
    ----------
    capture : Capture
        With the L-frame, or with a substitute from the wand on the floor or from the performer.
    given : Capture
        The capture without a substitute.
    draft : _Draft
    findings : tuple of Finding
        How the floor was determined, if there is no L-frame.
    """

    capture: Capture
    given: Capture
    draft: _Draft
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, capture: Capture, draft: _Draft) -> _FloorCapture:
        given = lframe_by_all_views(capture, draft.scene.rig)
        if given.floor:
            with_floor, finding = with_wand_on_floor(given, draft.scene.rig)
            return cls(with_floor, given, draft, (finding,))
        if given.performer is None:
            return cls(given, given, draft)
        standing = on_performers_floor(given, draft.scene.rig)
        return cls(
            standing.capture,
            replace(given, wand_length=standing.capture.wand_length),
            replace(draft, scene=draft.scene.scaled(standing.scale)),
            (standing.finding,),
        )


@dataclass(frozen=True, eq=False)
class _World:
    """A scene in the world of the L-frame, and the placement of the L-frame in it.

    Attributes
    ----------
    scene : Scene
    resting : BallObservations
        The L-frame's balls, without those of cameras that were moved.
    placement : LFramePose
    moved : dict of int to float
        Cameras that were moved between L-frame and wand, and by how many pixels.
    """

    scene: Scene
    resting: BallObservations
    placement: LFramePose
    moved: dict[int, float]

    @classmethod
    def of(cls, floor: _FloorCapture) -> _World:
        capture, draft = floor.capture, floor.draft
        still = resting([view.lframe for view in capture.views])
        moved = {} if capture.performer is not None else moved_since(draft.scene.rig, still, draft.noise)
        still = still.take(~np.isin(still.camera, list(moved)))
        try:
            placement = place_lframe(draft.scene.rig, still, capture.lframe_points, draft.noise)
            scene = draft.scene.in_world(placement.R, placement.t)
            check_lframe(placement, scene.rig, capture.lframe_points, capture.wand_length)
        except CaptureError:
            _refuse_other_size(floor)
            raise
        return cls(replace(scene, lframe_world=capture.lframe_points.copy()), still, placement, moved)


def _refuse_other_size(floor: _FloorCapture) -> None:
    """Raise a CaptureError where the views show the L-frame in another size than its measures and the wand's length
    say: where they are far apart, something else was taken for it.
    """
    sized = of_another_size(floor.given, floor.draft.scene.rig) if floor.given.has_lframe else None
    if sized is None:
        return
    still = resting([view.lframe for view in sized.views])
    placement = place_lframe(floor.draft.scene.rig, still, sized.lframe_points, floor.draft.noise)
    check_size(placement, sized.lframe_points, sized.wand_length)


def _finished(
    draft: _Draft, capture: Capture, synchrony: Synchrony, free: Bools, *, known: Sequence[Lens], steps: _ReportedSteps
) -> CalibrationResult:
    """Define the world by the L-frame, select the lens parameters, and adjust once more to all observations."""
    floor = _FloorCapture.of(capture, draft)
    world, capture, draft = _World.of(floor), floor.capture, floor.draft
    evidence = replace(
        _evidence(capture, draft.seen, synchrony), lframe=world.resting, lframe_measures=capture.lframe_points
    )
    steps.next("lenses", 0.7)
    fit = adjust(world.scene, evidence, free, cancel=steps.check)
    free = lens_selection.select_lens_unknowns(fit.scene, evidence, free, known, steps.check)
    seen, used = labelled(fit.scene, capture.views, draft.noise)
    evidence = replace(evidence, wand=seen)
    fit = adjust(fit.scene, evidence, free, stopping=_EXACTLY, cancel=steps.check)
    scene = fit.scene
    assert scene.lframe_world is not None
    noise = _unit_noise(fit.residual[: len(seen)], scene, free)
    inflation = variance_inflation(seen, fit.residual[: len(seen)])
    steps.next("quality", 0.9)
    held_out = _held_out(scene, evidence, free, steps)
    solution = CalibrationResult(
        capture=floor.given,
        rig=scene.rig,
        wand=scene.wand,
        lframe_world=scene.lframe_world,
        seen=seen,
        residual=BallObservations.joined([seen, world.resting]).in_pixels(fit.residual),
        used=used,
        free=free,
        covariance=covariance(scene, replace(evidence, lframe_sigma=_EXACT_SIGMA), fit.free)
        * max(noise, 1.0) ** 2
        * inflation,
        noise=noise,
        lframe_scale=world.placement.scale if floor.given.has_lframe else np.nan,
        moved=world.moved,
        held_out=held_out,
        findings=(),
    )
    return replace(solution, findings=(*floor.findings, *diagnosis.doubts(solution)))


def _unit_noise(residual: Array, scene: Scene, free: Bools) -> float:
    """Return the balls' noise as a multiple of sigma, from the sum of squares and the degrees of freedom."""
    left = residual.size - 5 * len(scene.wand) - free.sum()
    return float(np.sqrt((residual**2).sum() / max(left, 1)))


def _held_out(scene: Scene, evidence: BundleEvidence, free: Bools, steps: _ReportedSteps) -> Array:
    """Return lengths of the wand, metres, on runs of frames that were held out of the solution that measures them."""
    wand = scene.wand
    left_out = (np.arange(len(wand)) // _HELD_OUT_RUN) % _HELD_OUT == _HELD_OUT // 2
    times = scene.rig.times(evidence.wand.camera, evidence.wand.frame)
    nearest = np.clip(np.searchsorted(wand.frames, np.floor(times + 0.5)), 0, len(wand) - 1)
    out = left_out[nearest]
    if not out.any():
        return np.zeros(0)
    rest = replace(evidence, wand=evidence.wand.take(~out))
    scene = replace(scene, wand=wand.take(~left_out))
    fit = adjust(scene, rest, free, stopping=NEARLY_CONVERGED, cancel=steps.check)
    return measured_lengths(fit.scene.rig, evidence.wand.take(out), wand.frames[left_out])
