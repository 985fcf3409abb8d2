"""Measuring small balls again where a first solution expects them.

The first solution predicts how large every ball is in the picture, where the rods are, and where the wand is on frames
on which its balls were too faint to be found without a prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture.calibration_objects import LFRAME_ARMS, LFRAME_BALLS
from ..capture.capture import Markers
from ..numerics.arrays import Array
from ..runtime.processes.worker_pool import WorkerPool
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import one_library_thread
from ..shot.footage import pictures
from .balls.ball_appearance import BallAppearance, BallGuess, BallImage
from .balls.ball_images import fit_ball
from .calibration_result import CalibrationResult
from .expected_balls import MIN_WAND_FRAMES, ExpectedBalls, ball_diameter, wand_path
from .lframe.lframe_markers import SeenBalls, still_picture
from .video_markers import SeenView, VideoMarkers

Image = NDArray[Any]

_MAX_DISTANCE = 4.0
"""Largest distance of a ball from its expected position, pixels."""
_MIN_EXPLAINED = 0.75
"""Least fraction of a window's difference from the background that a ball must explain."""
_MAX_LIGHT_RATIO = 3.0
"""Largest factor between a ball's colour and its usual colour in that video, in linear light."""
_PLATE_FRAMES, _SAMPLES = 15, 12  # frames: for the background; for the balls' colours
_EXPOSURE = 0.5
"""Exposure as a fraction of the time between frames, before it is known."""
_EXPOSURE_SIGMA = 0.08  # standard deviation of a known exposure, relative
_MIN_BLUR_SPEED = 3.0  # pixels per frame from which motion blur shows the exposure
_MAX_LEVEL_DIFFERENCE = 10.0
"""Difference of levels below which the L-frame is still in the background picture."""
_UNMEASURED_RADIUS_SIGMA = 0.1  # standard deviation of radii if no diameter is given, relative


def remeasured(
    found: VideoMarkers,
    solution: CalibrationResult,
    progress: Progress | None = None,
    pool: WorkerPool | None = None,
) -> VideoMarkers:
    """Measure the small balls of all videos again, and search for those that were missed.

    Parameters
    ----------
    found : VideoMarkers
    solution : CalibrationResult
        The solution from these markers.
    progress : callable, optional
    pool : WorkerPool, optional
        See `find_all`.

    Raises
    ------
    FootageError
        A video cannot be read.
    CancelledError
        `progress` returned False.
    """
    tasks = [
        (f"small balls in {view.videos.camera}", partial(_measured_again, found, solution, c))
        for c, view in enumerate(found.views)
    ]
    views = (pool or WorkerPool(1)).do_all(tasks, progress)
    return VideoMarkers(found.videos, tuple(views))


@one_library_thread()
def _measured_again(found: VideoMarkers, solution: CalibrationResult, c: int, progress: Progress | None) -> SeenView:
    """Return a view with its small balls measured again, or as it is if it has none."""
    seen = _RemeasuredView.create(found, solution, c)
    return seen.measured(progress) if seen.is_small else seen.seen


def with_lframes_remeasured(found: VideoMarkers, solution: CalibrationResult) -> VideoMarkers:
    """The small balls of the L-frame measured once more by a solution that is better than the one before.

    The rods that meet in a ball say where its middle is. A first solution that has one ball in a wrong place has the
    rods to it go a wrong way, and there the ball is then found.

    Parameters
    ----------
    found : VideoMarkers
        As `remeasured` returns them.
    solution : CalibrationResult
        Solved from these.
    """
    views = []
    for c, view in enumerate(found.views):
        seen = _RemeasuredView.create(found, solution, c)
        if view.background is not None and view.videos.lframe is not None and seen.lframe.small.any():
            view = replace(view, lframe=seen.lframe_again(view.background))
        views.append(view)
    return VideoMarkers(found.videos, tuple(views))


@dataclass(frozen=True, eq=False)
class _RemeasuredView:
    """One camera's videos, with the balls that were found and those that are predicted."""

    seen: SeenView
    lframe: ExpectedBalls
    wand: ExpectedBalls
    radius_sigma: tuple[float, float]

    @classmethod
    def create(cls, found: VideoMarkers, solution: CalibrationResult, c: int) -> _RemeasuredView:
        videos, view, rig = found.videos, found.views[c], solution.rig
        given = videos.lframe_diameter, videos.wand_diameter
        sizes = [ball_diameter(found, solution, size, wand=bool(k)) for k, size in enumerate(given)]
        last = view.wand.markers.frames[-1] + 1 if len(view.wand.markers) else 0
        frames = np.arange(max(view.footage.count, int(last)))
        ends = wand_path(solution.wand, rig.times(np.full(len(frames), c), frames.astype(float)))
        return cls(
            view,
            ExpectedBalls.of(rig, c, solution.lframe_world[None], sizes[0]),
            ExpectedBalls.of(rig, c, ends, sizes[1]),
            (_sigma(given[0]), _sigma(given[1])),
        )

    @property
    def is_small(self) -> bool:
        """Whether any of its balls is small."""
        return bool(self.wand.small.any() or (self.lframe.small.any() and self.seen.videos.lframe is not None))

    def measured(self, progress: Progress | None) -> SeenView:
        """Return the view with its small balls measured again."""
        plate, appearance = self._learned()
        lframe = self.seen.lframe if self.seen.videos.lframe is None else self.lframe_again(plate)
        wand = self._wand(plate, appearance, progress)
        return replace(self.seen, lframe=lframe, wand=wand, background=plate.astype(np.float32))

    def _found(self) -> _MeasuredBalls:
        """Return the wand's balls found before, with the ends in the predicted order."""
        m, shape = self.seen.wand.markers, self.wand.radii.shape
        rows = _MeasuredBalls(
            np.full((*shape, 2), np.nan), np.full(shape, np.nan), np.full(shape, np.nan), np.zeros((*shape, 2))
        )
        for frame, points, sigma, radii in zip(m.frames, m.points, m.sigma, self.seen.wand.radii, strict=True):
            ends = self.wand.centres[frame]
            apart, crossed = (float(np.nansum((points[order] - ends) ** 2)) for order in ([0, 1], [1, 0]))
            order = [1, 0] if crossed < apart else [0, 1]
            rows.points[frame], rows.sigma[frame], rows.radii[frame] = points[order], sigma[order], radii[order]
        return rows

    def _learned(self) -> tuple[Image, _VideoAppearance]:
        """Learn the background, and the appearance of the wand's balls, from some of the frames."""
        found = self._found()
        whole = np.flatnonzero(np.isfinite(found.points).all(axis=(1, 2)) & self.wand.small.all(axis=1))
        sampled = set(whole[np.linspace(0, len(whole) - 1, min(_SAMPLES, len(whole))).astype(int)].tolist())
        spread = set(np.linspace(0, len(self.wand.radii) - 1, _PLATE_FRAMES).astype(int).tolist())
        kept = {f: image for f, image in enumerate(pictures(self.seen.videos.wand)) if f in sampled or f in spread}
        plate = np.median([kept[f] for f in sorted(spread & set(kept))], axis=0)
        lights: list[list[Array]] = [[], []]
        shares = []
        for f in sorted(sampled & set(kept)):
            for end in range(2):
                ball = fit_ball(kept[f], plate, self._guess(f, end, found.points[f, end], _VideoAppearance()))
                if ball is None or ball.explained < _MIN_EXPLAINED:
                    continue
                lights[end].append(np.log(ball.light))
                speed = float(np.linalg.norm(self.wand.velocities[f, end]))
                if speed > _MIN_BLUR_SPEED:
                    shares.append(float(np.linalg.norm(ball.path)) / speed)
        usual = [np.exp(np.median(own, axis=0)) if len(own) >= MIN_WAND_FRAMES else None for own in lights]
        if len(shares) < MIN_WAND_FRAMES:
            return plate, _VideoAppearance((usual[0], usual[1]))
        return plate, _VideoAppearance((usual[0], usual[1]), min(float(np.median(shares)), 1.0), _EXPOSURE_SIGMA)

    def _guess(self, frame: int, end: int, centre: Array, appearance: _VideoAppearance) -> BallGuess:
        radius = float(self.wand.radii[frame, end])
        rods, starts = self.wand.rods(frame, end, [1 - end])
        path = appearance.exposure * self.wand.velocities[frame, end]
        return BallGuess(
            centre,
            radius,
            self.radius_sigma[1],
            path=path,
            path_sigma=appearance.exposure_sigma,
            rods=rods,
            starts=starts,
            light=appearance.lights[end],
        )

    def _wand(self, plate: Image, appearance: _VideoAppearance, progress: Progress | None) -> SeenBalls:
        rows = self._found()
        aside = np.zeros((2, 2))  # of the ball on the frame before from where it was expected
        count = len(rows.points)
        for f, image in enumerate(pictures(self.seen.videos.wand)):
            if f >= count:
                break
            report_progress(progress, f"small balls in {self.seen.videos.camera}", f / count)
            for end in np.flatnonzero(self.wand.small[f]):
                ball = self._ball(image, plate, rows.points[f, end], (f, int(end), aside[end]), appearance)
                aside[end] = 0.0 if ball is None else ball.centre - self.wand.centres[f, end]
                if ball is not None or appearance.lights[end] is not None:
                    rows.put(f, int(end), ball)
        kept = np.flatnonzero(np.isfinite(rows.sigma).any(axis=1))
        markers = Markers(kept, rows.points[kept], rows.sigma[kept], rows.elongation[kept])
        return SeenBalls(markers, rows.radii[kept])

    def _ball(
        self, image: Image, plate: Image, before: Array, where: tuple[int, int, Array], appearance: _VideoAppearance
    ) -> BallImage | None:
        """Measure one end of the wand on one frame; None if it is not seen."""
        frame, end, aside = where
        expected = self.wand.centres[frame, end]
        usual = appearance.lights[end]
        was_seen = bool(np.linalg.norm(before - expected) < _MAX_DISTANCE)
        if usual is None and not was_seen:
            return None
        ball = fit_ball(image, plate, self._guess(frame, end, before if was_seen else expected + aside, appearance))
        if ball is None or ball.explained < _MIN_EXPLAINED or np.linalg.norm(ball.centre - expected) > _MAX_DISTANCE:
            return None
        if usual is not None and np.abs(np.log(ball.light / usual)).max() > np.log(_MAX_LIGHT_RATIO):
            return None
        return ball

    def lframe_again(self, plate: Image) -> SeenBalls:
        """The L-frame's small balls by their images before the picture without the wand."""
        path = self.seen.videos.lframe
        assert path is not None
        before = self._lframe_before()
        image = still_picture(path)
        m = before.markers
        rows = _MeasuredBalls(m.points.copy(), m.sigma.copy(), before.radii.copy(), np.zeros_like(m.points))
        empty = None if self._stays(image, plate) else plate
        fitted = self._lframe_balls(image, empty, m.points[0])
        if len(fitted) > 1:
            # A rod may hide whether the light comes from one side or the ball lies elsewhere: other balls show it.
            appearance = BallAppearance.common([ball.appearance for ball in fitted.values()])
            fitted |= self._lframe_balls(image, empty, m.points[0], appearance)
        usual = np.median([np.log(ball.light) for ball in fitted.values()], axis=0) if fitted else np.zeros(3)
        for k, ball in fitted.items():
            alike = np.abs(np.log(ball.light) - usual).max() < np.log(_MAX_LIGHT_RATIO)
            if alike or not np.isnan(m.points[0, k]).any():
                rows.put(0, k, ball)
        if np.isnan(rows.points).any(axis=-1).all():
            return self.seen.lframe
        return SeenBalls(Markers(m.frames, rows.points, rows.sigma, rows.elongation), rows.radii)

    def _lframe_balls(
        self, image: Array, empty: Image | None, found: Array, appearance: BallAppearance | None = None
    ) -> dict[int, BallImage]:
        """Those of the L-frame's small balls that are seen, from where they were found (4, 2) before, or not: NaN."""
        fitted: dict[int, BallImage] = {}
        for k in np.flatnonzero(self.lframe.small[0]).tolist():
            rods, starts = self.lframe.rods(0, k, [b if a == k else a for a, b in LFRAME_ARMS if k in (a, b)])
            missed = bool(np.isnan(found[k]).any())
            expected, radius = self.lframe.centres[0, k], float(self.lframe.radii[0, k])
            guess = BallGuess(expected if missed else found[k], radius, self.radius_sigma[0], appearance=appearance)
            ball = fit_ball(image, empty, replace(guess, rods=rods, starts=starts))
            far = missed and ball is not None and np.linalg.norm(ball.centre - expected) > _MAX_DISTANCE
            if ball is not None and ball.explained > _MIN_EXPLAINED and not far:
                fitted[k] = ball
        return fitted

    def _lframe_before(self) -> SeenBalls:
        """Return the L-frame's balls found before; a row of NaN if there were none."""
        if len(self.seen.lframe.markers):
            return self.seen.lframe
        nothing = np.full((1, LFRAME_BALLS), np.nan)
        return SeenBalls(Markers(np.zeros(1, np.int64), np.stack([nothing, nothing], axis=-1), nothing), nothing)

    def _stays(self, image: Image, plate: Image) -> bool:
        """Return whether the L-frame is still there while the wand is waved."""
        size = np.array(plate.shape[1::-1])
        places = np.round(np.nan_to_num(self.lframe.centres[0], nan=-1.0)).astype(int)
        u, v = places[((places >= 0) & (places < size)).all(axis=1)].T
        same = np.abs(image[v, u] - plate[v, u]).max(axis=1) < _MAX_LEVEL_DIFFERENCE
        return bool(same.sum() > len(same) / 2)


@dataclass(frozen=True, eq=False)
class _MeasuredBalls:
    """Balls on frames of a video as in `Markers`, with radii; NaN where they were not found."""

    points: Array
    sigma: Array
    radii: Array
    elongation: Array

    def put(self, row: int, column: int, ball: BallImage | None) -> None:
        """Enter a measured ball, or None if the model of its image does not explain the picture."""
        if ball is None:
            self.points[row, column] = self.sigma[row, column] = self.radii[row, column] = np.nan
            return
        self.points[row, column], self.elongation[row, column] = ball.centre, ball.elongation
        self.sigma[row, column], self.radii[row, column] = ball.sigma, ball.radius


@dataclass(frozen=True, eq=False)
class _VideoAppearance:
    """The appearance of the wand's balls in a video: colours in linear light, and exposure as a fraction of a frame."""

    lights: tuple[Array | None, Array | None] = (None, None)
    exposure: float = _EXPOSURE
    exposure_sigma: float = 0.3


def _sigma(diameter: float | None) -> float:
    """Return the standard deviation of predicted radii, relative."""
    return _UNMEASURED_RADIUS_SIGMA if diameter is None else BallGuess.radius_sigma
