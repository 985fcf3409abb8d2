"""Views on frames with key poses: what checks of cameras and footage look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...body.kinematics import Poses
from ...cameras.camera import Camera
from ...evidence.background_shift import BackgroundShift, background_shifts
from ...evidence.movement_match import key_poses_of
from ...evidence.rendering.label_images import render_labels
from ...evidence.rendering.part_geometry import Geometry
from ...numerics.arrays import Bools
from ...shot.shot import Shot, View
from ..key_frame_views import KeyFrameView


@dataclass(frozen=True, eq=False)
class PosedView:
    """A view on K frames with key poses of the whole body of every performer.

    Attributes
    ----------
    view : View
    frames : tuple of int
        The K frames, counted as in the shot file.
    pictures : ndarray of uint8, shape (K, h, w, 3)
        Reduced in size, without lens distortion; blue, green, red.
    camera : Camera
        That of the pictures, whose frame k is the k-th of them.
    factor : float
        Factor by which they are reduced.
    geometry : Geometry
        Of all performers.
    poses
        World poses of their parts on these frames.
    """

    view: View
    frames: tuple[int, ...]
    pictures: NDArray[np.uint8]
    camera: Camera
    factor: float
    geometry: Geometry
    poses: Poses

    @property
    def name(self) -> str:
        """The camera's name."""
        return self.view.camera.name

    @property
    def stands_still(self) -> bool:
        """Whether the camera should."""
        return self.view.camera.stands_still

    def on(self, chosen: Sequence[int]) -> PosedView:
        """Return the same on some of the K frames, by their numbers."""
        some, (R, T) = [*chosen], self.poses
        return replace(
            self,
            frames=tuple(self.frames[k] for k in some),
            pictures=self.pictures[some],
            camera=self.camera.at(some),
            poses=(R[some], T[some]),
        )

    @property
    def pixels_per_metre(self) -> float:
        """Scale of the pictures at the performers."""
        return self.camera.pixels_per_metre(self.poses[1].mean(axis=(0, 1)))

    @cached_property
    def performers(self) -> Bools:
        """Where the key poses are in the pictures, (K, h, w)."""
        return np.asarray(render_labels(self.geometry, self.camera, 0, *self.poses).part >= 0)

    @cached_property
    def background(self) -> list[BackgroundShift | None]:
        """How the background lies in each picture but the first, compared with that; see `background_shifts`."""
        return background_shifts(list(self.pictures), list(self.performers), self.frames, self.factor)


def posed_views(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> list[PosedView]:
    """Return the views of a shot with the key poses of some of its frames.

    Parameters
    ----------
    shot : Shot
    views : sequence of KeyFrameView
        The pictures of its views on those frames.
    frames : ndarray of int, shape (K,)
        Shot frames with key poses of the whole body.
    """
    geometry, poses = Geometry.of([performer.body for performer in shot.performers]), key_poses_of(shot, frames)
    counted = tuple((shot.frames[0] + frames).tolist())
    return [
        PosedView(
            view=view,
            frames=counted,
            pictures=pictured.rectified(view.camera),
            camera=pictured.camera(view.camera),
            factor=pictured.factor,
            geometry=geometry,
            poses=poses,
        )
        for view, pictured in zip(shot.views, views, strict=True)
    ]
