"""Shots of bodies of any size.

The tracker's lengths are those of people: how far errors are correlated on a surface, how fast joints accelerate, how
far beside the model limbs are searched for. A shot of a cat is therefore tracked as one of a cat of human size, with
everything in it enlarged, cameras included: the pictures are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from ..body.body import Body
from ..body.body_size import body_size
from ..body.motion import Motion
from ..keypoints.keypoint_rays import Keypoints
from ..keypoints.observations import PerformerKeypoints, ShotKeypoints
from ..numerics.arrays import Array
from ..runtime.processes.worker_pool import WorkerPool
from ..shot.grips import completed
from ..shot.motion_warping import with_keys
from ..shot.segments import Segment
from ..shot.settings import Settings
from ..shot.shot import Performer, Shot
from .results.track_result import TrackResult
from .scheduling.run_context import RunContext, SolvedShot
from .scheduling.schedule import Observer
from .track_state import Around

HUMAN_SIZES, HUMAN_SIZE = (1.0, 2.6), 1.7
"""Sizes of bodies that are tracked as they are, those of people, children included; and the size that others get,
metres.
"""
MIN_PROP_SIZE, PROP_SIZE = 0.2, 0.35
"""The same of a rigid prop: what is held in a hand moves far for its size. A hammer of 32 cm is tracked best with
factors of 0.7 to 1, four times worse with 5 and six times worse with 0.4 (docs/studies.md).
"""


@dataclass(frozen=True)
class ShotScale:
    """A factor by which all lengths of a shot are multiplied; with 1, everything stays the same object."""

    factor: float

    @classmethod
    def of(cls, shot: Shot) -> ShotScale:
        """Return the scale with which the largest body of a shot is as large as a person.

        Where one body is of human size already, the factor is 1. Rigid props count only where there is nothing else.
        """
        bodies = [performer.body for performer in shot.performers]
        jointed = [body for body in bodies if len(body) > 1]
        smallest, usual = (HUMAN_SIZES[0], HUMAN_SIZE) if jointed else (MIN_PROP_SIZE, PROP_SIZE)
        sizes = [body_size(body) for body in jointed or bodies]
        size = max(sizes, default=usual)
        if any(smallest <= one <= HUMAN_SIZES[1] for one in sizes) or not size > 0:
            return cls(1.0)
        return cls((usual if size < smallest else HUMAN_SIZE) / size)

    @property
    def back(self) -> ShotScale:
        """The scale from the enlarged shot to the shot as it is given."""
        return ShotScale(1 / self.factor)

    def shot(self, shot: Shot) -> Shot:
        """Scale a shot: cameras, bodies, key poses, grips, and settings that are lengths."""
        if self.factor == 1:
            return shot
        cameras = [replace(v.camera, t_cam_world=self.factor * v.camera.t_cam_world) for v in shot.views]
        grips = [h.grip and replace(h.grip, places=self.factor * h.grip.places) for h in shot.holds]
        return replace(
            shot,
            views=tuple(replace(v, camera=camera) for v, camera in zip(shot.views, cameras, strict=True)),
            performers=tuple(self._performer(performer) for performer in shot.performers),
            settings=self._settings(shot.settings),
            holds=tuple(replace(h, grip=grip) for h, grip in zip(shot.holds, grips, strict=True)),
        )

    def completed(self, shot: Shot) -> Shot:
        """Return the given shot, not scaled, with what depends on the whole of it filled in."""
        filled = completed(replace(shot, settings=self._settings(shot.settings)))
        return replace(filled, settings=self.back._settings(filled.settings))

    def motions(self, motions: Iterable[Motion]) -> tuple[Motion, ...]:
        """Scale motions."""
        if self.factor == 1:
            return tuple(motions)
        return tuple(Motion(self.factor * motion.translations, motion.rotations) for motion in motions)

    def motions_back(self, motions: Iterable[Motion], performers: Sequence[Performer]) -> tuple[Motion, ...]:
        """Scale motions of a scaled shot back; the given performers' key poses are exact again."""
        found = self.back.motions(motions)
        if self.factor == 1:
            return found
        return tuple(with_keys(motion, own.key_poses) for motion, own in zip(found, performers, strict=True))

    def around(self, around: Around) -> Around:
        """Scale the poses beside a shot."""
        before, after = (poses if poses is None else self.motions(poses) for poses in around)
        return before, after

    def run(self, run: RunContext) -> RunContext:
        """Return the services of a scaled shot's run, which hand out what they get in the given shot's lengths."""
        show, solved, back = run.show, run.solved, self.back
        if self.factor == 1:
            return run

        def shown(segment: Segment, motions: tuple[Motion, ...]) -> None:
            if show is not None:
                show(segment, back.motions(motions))

        def handed_back(pool: WorkerPool, found: SolvedShot) -> None:
            if solved is not None:
                solved(pool, replace(found, observed=back._observed(found.observed)))

        return replace(run, show=show and shown, solved=solved and handed_back)

    def observer(self, observe: Observer | None) -> Observer | None:
        """Return an observer of a scaled shot that hands out motions in the given shot's lengths."""
        if observe is None or self.factor == 1:
            return observe
        given: Callable[[Segment, int, Sequence[Motion]], None] = observe
        return lambda segment, iteration, motions: given(segment, iteration, self.back.motions(motions))

    def result(self, result: TrackResult, performers: Sequence[Performer]) -> TrackResult:
        """Scale the result of a scaled shot back; the given performers' key poses are exact again."""
        if self.factor == 1:
            return result
        back = self.back
        return replace(
            result,
            motions=self.motions_back(result.motions, performers),
            segments=tuple(
                replace(one, accelerations=tuple(back._of_root(own) for own in one.accelerations))
                for one in result.segments
            ),
            errors=tuple(
                replace(own, deviation=back.factor * own.deviation, interval=back.factor * own.interval)
                for own in result.errors
            ),
            observed=back._observed(result.observed),
        )

    def _performer(self, performer: Performer) -> Performer:
        keys, apart = performer.key_poses, performer.joint_deviation
        (poses,) = self.motions([keys.poses])
        return replace(
            performer,
            body=self._body(performer.body),
            key_poses=replace(keys, poses=poses),
            joint_deviation=None if apart is None else self.factor * apart,
        )

    def _body(self, body: Body) -> Body:
        parts = [
            replace(
                part,
                head_world=self.factor * part.head_world,
                tail_world=self.factor * part.tail_world,
                vertices=self.factor * part.vertices,
            )
            for part in body.parts
        ]
        return Body(tuple(parts), {name: (i, self.factor * point) for name, (i, point) in body.landmarks.items()})

    def _settings(self, settings: Settings) -> Settings:
        if self.factor == 1:
            return settings
        lengths = ("correlation_length", "outline_correlation", "root_acceleration")
        given = {name: value for name in lengths if (value := getattr(settings, name)) is not None}
        return replace(settings, **{name: self.factor * value for name, value in given.items()})

    def _of_root(self, groups: Array, power: int = 1) -> Array:
        """Scale the first of G groups, which is the root's place; the others are turns."""
        return groups * [self.factor**power, *[1.0] * (len(groups) - 1)]

    def _observed(self, observed: ShotKeypoints) -> ShotKeypoints:
        return replace(observed, performers=tuple(self._keypoints(own) for own in observed.performers))

    def _keypoints(self, own: PerformerKeypoints) -> PerformerKeypoints:
        factor = own.factor
        places = factor.places
        (motion,) = self.motions([own.motion])
        return replace(
            own,
            motion=motion,
            factor=replace(
                factor,
                keypoints=self._rays(factor.keypoints),
                places=replace(places, local=self.factor * places.local, offsets=self.factor * places.offsets),
                sigma=None if factor.sigma is None else self.factor * factor.sigma,
                imagined=None if factor.imagined is None else self._rays(factor.imagined),
            ),
            typical_variances=self._of_root(own.typical_variances, 2),
        )

    def _rays(self, keypoints: Keypoints) -> Keypoints:
        return replace(keypoints, t_cam_world=self.factor * keypoints.t_cam_world)
