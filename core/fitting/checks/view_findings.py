"""What is found about a view that is compared with the key poses or with the other views, in words for the user.

Every finding has a `camera`, says in `by` what the view was compared by, whether it is `off`, and if so in a few words
(`brief`) and on one line (`summary`) what is wrong. Its `figures` are what report.json says of it beside these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from ...evidence.background_shift import BackgroundShift
from ...evidence.background_turn import MIN_ZOOM
from ...evidence.movement_match import MIN_MATCH
from ..camera_fits.keypoint_cameras import PictureShift
from .picture_findings import DissolvingPictures, FadingPictures, FindingWithoutFigures, FlickeringLight, Strangers

_MIRROR = "mirror its footage back, as with: ffmpeg -i FOOTAGE -vf hflip -crf 14 CONVERTED.mp4"
_ZOOM = (
    "a calibration holds for one focal length and place: film with a fixed zoom, leave the view out with --views, or "
    "solve the camera's motion, as in Blender"
)
_PLAIN = "its background is too plain to tell whether its camera moved"
_HELD = (
    "if it was held in the hand, stabilise its footage, give the camera's motion, or leave the view out with --views; "
    "next time, put marks on the wall"
)
_STABILISE = (
    "its pictures do not tell how it turned, or stabilise = false; stabilise its footage, as with: ffmpeg -i FOOTAGE "
    "-vf vidstabdetect=tripod=1 -f null - && ffmpeg -i FOOTAGE -vf vidstabtransform=tripod=1:optzoom=0 -crf 14 "
    "CONVERTED.mp4; or solve the camera's motion, as in Blender"
)


@dataclass(frozen=True)
class CameraFit(PictureShift):
    """How well a camera fits the others or the key poses.

    Attributes
    ----------
    camera : str
    by : str
        What it was compared with: "keypoints" or "key poses".
    plain : bool
        Whether its background is too plain to tell whether it moved, which may be why it is off.
    """

    camera: str
    by: Literal["keypoints", "key poses"]
    plain: bool = False

    @property
    def brief(self) -> str:
        """A few words on how far the camera is off."""
        return f"{self.shift:.0f} px off the {'other cameras' if self.by == 'keypoints' else 'key poses'}"

    @property
    def figures(self) -> dict[str, Any]:
        """How far it is off, pixels."""
        return {name: round(getattr(self, name), 1) for name in ("shift", "deviation", "limit")}

    @property
    def summary(self) -> str:
        """One line on a camera that does not fit."""
        plain = f"; {_PLAIN}: {_HELD}" if self.plain else ""
        return f"{self.camera}: its picture is {self.brief}; up to {self.limit:.0f} px could be chance{plain}"


@dataclass(frozen=True)
class FootageMatch:
    """How well a view's footage matches the key poses.

    Attributes
    ----------
    camera : str
    match : float
        Probability that a pixel of the performers differs more between two key frames than one beside them.
    offset : float, optional
        An offset of the view (see `View`) with which it matches much better.
    mirrored : float, optional
        The match of the footage if it is mirrored, left for right, where that is much better.
    shows : str, optional
        The camera that seems to have taken it, if that is another one.
    by : str
    """

    camera: str
    match: float
    offset: float | None = None
    mirrored: float | None = None
    shows: str | None = None
    by: Literal["movement"] = "movement"

    @property
    def explained(self) -> bool:
        """Whether it is known what is wrong, so that no offset has to be tried."""
        return self.mirrored is not None or self.shows is not None

    @property
    def off(self) -> bool:
        """Whether this is hardly the footage in which the poses were set."""
        return self.match < MIN_MATCH or self.offset is not None or self.explained

    @property
    def brief(self) -> str:
        """A few words on what is wrong."""
        if self.mirrored is not None:
            return "its pictures seem to be mirrored"
        if self.shows is not None:
            return f"its footage seems to be that of {self.shows}"
        if self.offset is not None:
            return f"an offset of {self.offset:g} fits the key poses better"
        return "footage and key poses do not belong together"

    @property
    def figures(self) -> dict[str, Any]:
        """The match, and with what it would be better."""
        match = {"match": round(self.match, 2)}
        if self.mirrored is not None:
            return {**match, "mirrored": round(self.mirrored, 3)}
        if self.shows is not None:
            return {**match, "shows": self.shows}
        return match if self.offset is None else {**match, "offset": self.offset}

    @property
    def summary(self) -> str:
        """One line on what is wrong and what to look for."""
        if self.mirrored is not None:
            return (
                f"{self.camera}: its pictures seem to be mirrored, left for right: mirrored back, they change where "
                f"the key poses move (agreement {self.mirrored:.3f} instead of {self.match:.3f}); {_MIRROR}"
            )
        if self.shows is not None:
            return (
                f"{self.camera}: {self.brief}: its pictures change where {self.shows} sees the key poses move "
                f"(agreement {self.match:.3f} as it is): see which video belongs to which camera"
            )
        if self.offset is not None:
            return f"{self.camera}: its pictures fit the key poses better with an offset of about {self.offset:g}"
        return (
            f"{self.camera}: its pictures do not change where the key poses move (agreement {self.match:.2f}, of at "
            f"most 1; chance gives 0.5): check that this is the footage of {self.camera}, that its offset is right, "
            "and that the key poses and the calibration belong to this shot; large things that move beside the "
            "performers, such as shadows, or pictures that dissolve cause it, too"
        )


@dataclass(frozen=True)
class MovedCamera:
    """A camera that was moved during the shot, or held in the hand, or whose lens zooms, though its calibration has one
    pose and one focal length.

    Attributes
    ----------
    camera : str
    background : BackgroundShift
        How far the background lies elsewhere on one frame of the shot than on another.
    followed : bool
        Whether how it turned and zoomed was measured and is allowed for.
    zoom : BackgroundShift, optional
        Of one that was followed and zooms: on which frames its background is smallest and largest.
    by, off
        As of other findings.
    """

    camera: str
    background: BackgroundShift
    followed: bool = False
    zoom: BackgroundShift | None = None
    by: Literal["background"] = "background"
    off: Literal[True] = True

    @property
    def brief(self) -> str:
        """A few words on how far it moved."""
        if self._zooms:
            return f"its camera zooms, or moves: the background gets {self.background.enlarged:.0%} of its size"
        what = f"its camera moved: the background shifts by {self.background.pixels:.0f} px"
        if self.zoom is not None:
            what += f", and its lens zooms, to {self.zoom.enlarged:.0%}"
        return f"{what} (measured and allowed for)" if self.followed else what

    @property
    def figures(self) -> dict[str, Any]:
        """How the background lies elsewhere: pixels, a ratio, and on which frames; of a lens that zooms, those of the
        ratio.
        """
        scaling = self.zoom or self.background
        shift, enlarged = round(self.background.pixels, 1), round(scaling.enlarged, 3)
        return {"shift": shift, "frames": list(scaling.frames), "enlarged": enlarged, "followed": self.followed}

    @property
    def _zooms(self) -> bool:
        """Whether turns do not explain how the background lies."""
        return not self.followed and abs(math.log(self.background.enlarged)) > MIN_ZOOM

    @property
    def summary(self) -> str:
        """One line on how far it moved and what was done, or what to do."""
        before, after = self.background.frames
        if self._zooms:
            return (
                f"{self.camera}: the background has {self.background.enlarged:.0%} of its size on frame {before} on "
                f"frame {after}: its lens zooms, or the camera comes closer or goes away; {_ZOOM}"
            )
        done = "how it turned was measured in the pictures and is allowed for"
        if self.zoom is not None:
            smallest, largest = self.zoom.frames
            return (
                f"{self.camera}: its lens zooms, or the camera comes closer or goes away: the background is "
                f"{self.zoom.enlarged:.0%} as large on frame {largest} as on frame {smallest}, and turns by up to "
                f"{self.background.pixels:.0f} px, but the calibration has one focal length and one pose; how it "
                "zoomed and turned was measured in the pictures and is allowed for, as if it had stayed in its place"
            )
        return (
            f"{self.camera}: its camera moved: the background lies {self.background.pixels:.0f} px elsewhere on frame "
            f"{after} than on frame {before}, but the calibration has one pose; {done if self.followed else _STABILISE}"
        )


@dataclass(frozen=True)
class PlainBackground(FindingWithoutFigures):
    """A camera of which it cannot be seen whether it moved, as others of the shot did."""

    by: Literal["plain background"] = "plain background"
    brief: ClassVar[str] = _PLAIN
    advice: ClassVar[str] = f", as others of this shot did: {_HELD}"


ViewFinding: TypeAlias = (
    CameraFit
    | FootageMatch
    | MovedCamera
    | PlainBackground
    | FlickeringLight
    | FadingPictures
    | DissolvingPictures
    | Strangers
)
