"""Recognising degenerate captures: before solving, from the links between views, and from a solution."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..capture.calibration_objects import LFRAME_BALLS
from ..capture.capture import Capture
from ..errors import CaptureError
from ..numerics.arrays import Array
from . import findings
from .findings import Finding
from .quality import coverage, depths, path_error, seen_points, thickness
from .solving.camera_rig import DRIFT, FOCAL, OFFSET
from .solving.view_links import MAX_PLANE_SHARE, MIN_LINK_FRAMES, Link
from .solving.wand_motion import Wand
from .solving.wand_tracks import Tracks

if TYPE_CHECKING:
    from .calibration_result import CalibrationResult


MAX_WAND_LENGTH = 10.0
"""Length, metres, from which a wand's was given in another unit."""
MIN_AGREEING_SHARE = 0.3
"""Least fraction of the balls that must agree with two views' epipolar geometry, as some always do by chance."""
MIN_USED_SHARE = 0.3
"""Least fraction of a camera's balls that the solution must explain as the wand's."""
FLAGGED_NOISE_SHARE, REFUSED_NOISE_SHARE = 0.02, 0.1
"""Noise of the balls, relative to the wand's length in the picture, from which a capture is flagged, and refused."""
MIN_DEPTH_RATIO = 1.15
"""Ratio of the wand's largest to its smallest distance from a camera, below which it stayed at one depth."""
MIN_THICKNESS = 0.03
"""Ratio of thickness to width below which a cloud of balls is a plane."""
MAX_FOCAL_SIGMA, MAX_OFFSET_SIGMA = 0.01, 0.1
"""Standard deviations from which a focal length (relative) and an offset (frames) are flagged as uncertain."""
MIN_COVERAGE = 0.12
"""Fraction of a picture covered by the wand, below which distortion elsewhere is a guess."""
FEW_SHARED_FRAMES = 60
"""Number of frames shared with other cameras, below which a camera is flagged."""
MOST_FRAMES = 0.8
"""Share of a camera's frames from which on its clock may be wrong, rather than its place."""
MAX_NOISE_RATIO = 4.0
"""Noise of the balls, as a multiple of their sigma, from which it is flagged."""


def check_capture(capture: Capture) -> None:
    """Check that a capture is complete.

    Raises
    ------
    CaptureError
        It is not.
    """
    names = [view.camera for view in capture.views]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise CaptureError("the camera is listed twice", name="camera-twice", where=twice)
    if len(names) < 2:
        todo = "film with more, or find a single camera from a performer with --performer"
        raise CaptureError("a wand needs at least two cameras", name="one-camera", todo=todo)
    if not (np.isfinite(capture.wand_length) and capture.wand_length > 0):
        raise CaptureError("the wand's length must be greater than 0", name="wand-length-wrong")
    if capture.wand_length > MAX_WAND_LENGTH:
        raise findings.too_long(capture.wand_length).error()
    if capture.has_lframe:
        _check_lframe(capture.lframe_points)
    for view in capture.views:
        whole = int(view.wand.seen.all(axis=1).sum())
        if whole < MIN_LINK_FRAMES:
            raise findings.few_shared(view.camera, whole, MIN_LINK_FRAMES).error()
        pixels, share = _wand_in_picture(view.wand.points, view.wand.sigma)
        if share > REFUSED_NOISE_SHARE:
            raise findings.too_small(view.camera, pixels, share).error()


def _check_lframe(points: Array) -> None:
    if points.shape != (LFRAME_BALLS, 3) or not np.isfinite(points).all():
        raise CaptureError("the L-frame must have four points of three numbers", name="lframe-lengths-contradict")
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-3:
        raise findings.contradicting("the L-frame's points lie on one line").error()


def _wand_in_picture(points: Array, sigma: Array) -> tuple[float, float]:
    """Return the median length of a wand in pixels, and the noise relative to it."""
    length = np.linalg.norm(points[:, 0] - points[:, 1], axis=1)
    pixels = float(np.nanmedian(length))
    return pixels, float(np.sqrt(2) * np.nanmedian(sigma) / max(pixels, 1e-9))


def check_links(names: Sequence[str], links: Sequence[Link], tracks: Tracks) -> None:
    """Check that shared frames connect all views, and that the wand did not stay in one plane.

    Raises
    ------
    CaptureError
        They do not, or it did.
    """
    _check_joined(names, [link.views for link in links], tracks)
    agreeing = [link for link in links if link.agreeing >= MIN_AGREEING_SHARE * 2 * len(link.frames)]
    joined = {v for link in agreeing for v in link.views}
    for v, name in enumerate(names):
        if v not in joined:
            raise findings.no_geometry(name).error()
    flat = [link.geometry is not None and link.geometry.flatness > MAX_PLANE_SHARE for link in agreeing]
    if all(flat):
        raise findings.in_a_plane().error()
    _check_joined(names, [link.views for link in agreeing], tracks)


def unsolved(names: Sequence[str], links: Sequence[Link]) -> Finding:
    """Return why no cameras were found: the wand in a plane, if such views connect all cameras, or no agreement."""
    flat = [link.views for link in links if link.geometry is not None and link.geometry.flatness > MAX_PLANE_SHARE]
    return findings.in_a_plane() if len(set(_groups(len(names), flat))) == 1 else findings.nothing_agrees()


def _groups(count: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return the connected component of each view."""
    group = list(range(count))
    for i, j in pairs:
        group = [group[i] if g == group[j] else g for g in group]
    return group


def _check_joined(names: Sequence[str], pairs: Sequence[tuple[int, int]], tracks: Tracks) -> None:
    """Raise an error if pairs do not connect all views."""
    group = _groups(len(names), pairs)
    if len(set(group)) == 1:
        return
    whole = tracks.seen.all(axis=2)
    for v, name in enumerate(names):
        shared = int((whole[v] & (whole.sum(axis=0) >= 2)).sum())
        if group.count(group[v]) == 1 and 0 < shared < MIN_LINK_FRAMES:
            raise findings.few_shared(name, shared, MIN_LINK_FRAMES).error()
    small = min(set(group), key=group.count)
    inside = [name for name, g in zip(names, group, strict=True) if g == small]
    raise findings.unlinked(inside, [name for name in names if name not in inside]).error()


def check_solution(names: Sequence[str], used: Array, wand: Wand) -> None:
    """Check that cameras explain what they saw, and were not solved from a wand in one plane.

    Raises
    ------
    CaptureError
        They do not, or they were.
    """
    if np.median(used) < MIN_USED_SHARE:
        raise findings.nothing_agrees().error()
    for name, share in zip(names, used, strict=True):
        if share < MIN_USED_SHARE / 2:
            raise findings.no_geometry(name).error()
    if thickness(wand.ends_world.reshape(-1, 3)) < MIN_THICKNESS:
        raise findings.in_a_plane().error()


def doubts(solution: CalibrationResult) -> Iterator[Finding]:
    """Generate findings on a solution that its user should know."""
    near, far = depths(solution)[:, [0, 2]].T
    covered, sigma = coverage(solution), solution.sigma
    for c, view in enumerate(solution.capture.views):
        pixels, share = _wand_in_picture(view.wand.points, view.wand.sigma * solution.noise)
        if share > FLAGGED_NOISE_SHARE:
            yield findings.too_small(view.camera, pixels, share)
        shared = _shared_frames(solution, c)
        if shared < FEW_SHARED_FRAMES:
            yield findings.few_shared(view.camera, shared, FEW_SHARED_FRAMES)
        if thickness(seen_points(solution, c)) < MIN_THICKNESS:
            yield findings.in_a_plane(view.camera)
        if far[c] < MIN_DEPTH_RATIO * near[c]:
            yield findings.one_depth(view.camera, near[c], far[c])
        if sigma[c, FOCAL] > MAX_FOCAL_SIGMA:
            yield findings.focal_vague(view.camera, sigma[c, FOCAL])
        if sigma[c, OFFSET] > MAX_OFFSET_SIGMA:
            yield findings.offset_vague(view.camera, sigma[c, OFFSET])
        if covered[c] < MIN_COVERAGE:
            yield findings.little_covered(view.camera, covered[c])
    for c, pixels in solution.moved.items():
        what = f"it sees the L-frame {pixels:.1f} pixels beside where the others do, as if moved between the takes"
        yield findings.camera_moved(solution.rig.names[c], what)
    yield from _moved(solution)
    if solution.noise > MAX_NOISE_RATIO:
        yield findings.noisy(solution.noise)


def _shared_frames(solution: CalibrationResult, c: int) -> int:
    """Return the number of frames on which a camera sees the wand together with others."""
    times = np.round(solution.rig.times(solution.seen.camera, solution.seen.frame)).astype(np.int64)
    own = np.unique(times[solution.seen.camera == c])
    return len(np.intersect1d(own, times[solution.seen.camera != c]))


def _moved(solution: CalibrationResult) -> Iterator[Finding]:
    """Generate findings on cameras in whose picture the wand's path jumps: they were moved, or their lens is unlike the
    model. What befalls all of them is hardly their tripods.
    """
    errors = {view.camera: path_error(solution, c) for c, view in enumerate(solution.capture.views)}
    found = {camera: error for camera, error in errors.items() if error is not None}
    if edges := [camera for camera, error in found.items() if error.at_edges]:
        yield findings.lens_not_fitted(edges, max(found.pop(camera).pixels for camera in edges))
    if len(found) == len(errors) > 2:
        yield findings.all_moved(max(error.pixels for error in found.values()))
        return
    for camera, error in found.items():
        first, last = error.first, error.last
        what = f"on frames {first} to {last} it sees the wand {error.pixels:.1f} pixels beside where the others do"
        c = solution.rig.names.index(camera)
        own = solution.seen.frame[solution.seen.camera == c]
        clock = solution.free[c, OFFSET] and not solution.free[c, DRIFT] and last - first > MOST_FRAMES * np.ptp(own)
        yield findings.clock_off(camera, what) if clock else findings.camera_moved(camera, what)
