"""Problems of a capture, for which it is refused or flagged; each has a name and a remedy."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import CaptureError
from ..shot.footage_faults.footage_times import FootageRate

LFRAME_NOT_SEEN = "lframe-not-seen"
"""Name of the finding that no view sees the L-frame."""


@dataclass(frozen=True)
class Finding:
    """A problem that the user should know before relying on the cameras.

    Its name says of what kind it is, `where` which camera has it, if it is one camera's.
    """

    name: str
    what: str
    todo: str
    where: str | None = None

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{self.name}: {place}{self.what} ({self.todo})"

    def error(self) -> CaptureError:
        """Return the error that refuses a capture for this reason."""
        return CaptureError(f"{self.name}: {self.what}", name=self.name, where=self.where, todo=self.todo)


def few_shared(camera: str, frames: int, needed: int) -> Finding:
    """A camera shares too few frames of the wand with the others."""
    what = f"it shares only {frames} frames of the wand with the other cameras, {needed} are needed"
    return Finding("too-few-shared-frames", what, "wave the wand longer where this camera and others see it", camera)


def unlinked(cameras: list[str], others: list[str]) -> Finding:
    """Two groups of cameras never see the wand together."""
    never = "never sees" if len(cameras) == 1 else "never see"
    what = f"{', '.join(cameras)} {never} the wand together with {', '.join(others)}"
    return Finding("cameras-not-linked", what, "wave the wand where cameras of both groups see it")


def no_geometry(camera: str) -> Finding:
    """What a camera sees fits no other camera's view."""
    what = "what it sees of the wand fits no other camera's"
    todo = (
        "see that its offset, frame rate and colours are right, that its pictures are neither mirrored nor slowed "
        "down, and that it saw the same waving, for a third of the shorter video or more"
    )
    return Finding("camera-fits-no-other", what, todo, camera)


def in_a_plane(camera: str | None = None) -> Finding:
    """The wand moved in one plane."""
    todo = "wave it through the whole room: high and low, near and far, upright and level"
    return Finding("wand-in-a-plane", "the wand moved in one plane, which leaves focal lengths open", todo, camera)


def one_depth(camera: str, near: float, far: float) -> Finding:
    """The wand stayed at one distance from a camera."""
    what = f"the wand stayed between {near:.2f} m and {far:.2f} m from it, which leaves its focal length open"
    return Finding("wand-at-one-depth", what, "also wave it nearer to this camera and farther from it", camera)


def too_small(camera: str, pixels: float, share: float) -> Finding:
    """The wand is too small in a camera's picture for the noise of its balls."""
    what = f"the wand is only {pixels:.0f} pixels long, {share:.0%} of which is the balls' noise"
    return Finding("wand-too-small", what, "take a longer wand, wave it nearer, or film in a higher resolution", camera)


def lframe_unseen(what: str) -> Finding:
    """The L-frame is not seen by enough cameras."""
    todo = "film the L-frame so that at least two cameras see all of its balls, or all but one on the long arm"
    return Finding(LFRAME_NOT_SEEN, what, todo)


def lframe_missed(camera: str) -> Finding:
    """A camera's video of the L-frame does not show it to be found."""
    what = "the L-frame was not found in its video: where it stands follows from the wand and the other cameras"
    return Finding("lframe-missed", what, "see that the L-frame is in the picture and lit, and its colour", camera)


def floor_unseen(first: int, last: int) -> Finding:
    """Fewer than two cameras see the wand at rest on the floor."""
    what = f"fewer than two cameras see both balls of the wand at rest on frames {first} to {last}"
    return Finding("floor-not-seen", what, "check the frames of [floor], or lay the wand where more cameras see it")


def floor_in_a_line() -> Finding:
    """Both places of the wand lie on one line."""
    what = "the wand lies on one line in both places, which leaves the slope of the floor open"
    return Finding("floor-in-a-line", what, "lay it across the first place, or well beside it")


def floor_by_wand(misfit: float) -> Finding:
    """The floor is the wand's, not an L-frame's."""
    plane = f"its balls lie within {1000 * misfit:.1f} mm of one plane"
    what = f"floor, origin and axes are those of the wand on the floor; {plane}"
    return Finding("floor-by-wand", what, "an L-frame with long arms makes the floor more level")


def performer_unseen(first: int, last: int) -> Finding:
    """Fewer than two cameras have points of the performer in one place."""
    what = f"fewer than two cameras have both feet and the head of the performer on frames {first} to {last}"
    return Finding("performer-not-seen", what, "check the frames of [floor], or mark the points in more cameras")


def performer_not_upright(worst: float) -> Finding:
    """By the points the performer does not stand upright on a floor, or not in every place."""
    what = f"the performer's heights in the places differ by {1000 * worst:.0f} mm, so they do not stand upright"
    todo = "check the frames of [floor], and that the points are left foot, right foot and top of the head"
    return Finding("performer-not-upright", what, todo)


def performer_wrong_height(found: float, given: float) -> Finding:
    """The height contradicts the wand's length."""
    what = f"by the wand the performer is {found:.2f} m tall, not {given:.2f} m"
    todo = "check the wand's length and the height, or leave the length out to take the scale from the height"
    return Finding("performer-height-wrong", what, todo)


def floor_by_performer(height: float, degrees: float, *, scaled: bool) -> Finding:
    """The floor is that on which a performer stands."""
    scale = "so is the scale" if scaled else f"by the wand they are {height:.3f} m tall"
    what = f"floor, origin and axes are those of the performer's feet, level to about {degrees:.1f} degrees; {scale}"
    return Finding("floor-by-performer", what, "an L-frame, or a wand on the floor, is more precise")


def lframe_mirrored() -> Finding:
    """The L-frame's measures are mirrored."""
    todo = "turn the short arm's measure about (y to -y), or see that the balls are in their order"
    return Finding("lframe-mirrored", "by the L-frame all cameras stand below its floor", todo)


def contradicting(what: str) -> Finding:
    """The L-frame's measures contradict what the cameras see."""
    todo = "measure the L-frame's balls again, from centre to centre, and see that they are in their order"
    return Finding("lframe-lengths-contradict", what, todo)


def all_moved(pixels: float) -> Finding:
    """The wand's path jumps in the pictures of all cameras."""
    what = f"in all cameras, the wand now and then lies up to {pixels:.1f} pixels beside where the others see it"
    todo = "switch image stabilisers, digital zoom and automatic focus off, fasten the tripods, and film again"
    return Finding("pictures-unsteady", what, todo)


def lens_not_fitted(cameras: list[str], pixels: float) -> Finding:
    """The lens of some cameras is unlike the model of distortion, towards the edges of their pictures."""
    what = (
        f"{', '.join(cameras)}: towards the edges of the picture the wand lies up to {pixels:.1f} pixels beside where "
        "the others see it, as with a fisheye lens, which the model of distortion does not fit there"
    )
    todo = "choose the camera's linear or narrow mode, or keep the performer away from the edges"
    return Finding("lens-not-fitted", what, todo)


def wrong_length(scale: float, length: float) -> Finding:
    """The wand's length contradicts the L-frame's measures."""
    what = (
        f"the L-frame is {scale:.4f} times as large by the wand as by its own measures; "
        f"if those are right the wand is {length / scale:.4f} m long, not {length:.4f} m"
    )
    todo = "measure the wand and the L-frame again, from centre to centre of the balls"
    return Finding("wand-length-wrong", what, todo)


def too_long(length: float) -> Finding:
    """The wand's length was hardly given in metres."""
    todo = "give the measures of the wand and of the L-frame in metres"
    return Finding("wand-length-wrong", f"a wand of {length:g} m is longer than any", todo)


def camera_moved(camera: str, what: str) -> Finding:
    """A camera was moved during the capture."""
    todo = "fasten the tripod, switch off its stabiliser and film again, or leave out the frames after the move"
    return Finding("camera-moved", what, todo, camera)


def views_exchanged(cameras: tuple[str, str]) -> Finding:
    """Two cameras see the L-frame each where the other should."""
    what = "each sees the L-frame where the other should: their videos of it, or those of the wand, are exchanged"
    todo = "give each [[view]] the videos of its own camera"
    return Finding("views-exchanged", what, todo, " and ".join(cameras))


def clock_off(camera: str, what: str) -> Finding:
    """A camera sees the wand elsewhere on most of its frames: its clock runs at another speed, or it was moved."""
    todo = (
        "see that its frame rate is right, or solve with --drift; if that does not help, it was moved: fasten the "
        "tripod and film again"
    )
    return Finding("camera-moved", what, todo, camera)


def offset_unknown(camera: str) -> Finding:
    """The time offset of a camera cannot be estimated."""
    what = "its time offset cannot be determined: it saw too little of the wand's path at the same time as others"
    todo = "wave the wand for longer while all cameras run, or give 'offset' in its [[view]]"
    return Finding("offset-unknown", what, todo, camera)


def not_waved() -> Finding:
    """Time offsets are needed, but the wand was not waved smoothly."""
    what = "time offsets are to be estimated, but the wand jumps from frame to frame"
    todo = "give every [[view]] its offset (0 where cameras run in step), or points of every frame"
    return Finding("wand-jumps", what, todo)


def rate_varies(camera: str, rate: FootageRate) -> Finding:
    """The frames of a camera's video of the wand do not come at a constant rate, as those of many telephones."""
    what = (
        f"the frame rate of its video of the wand varies: frame {rate.frame} is {rate.astray:.1f} frames off a "
        f"constant rate of {rate.rate:.4g}"
    )
    todo = f"convert it, as with: ffmpeg -i FOOTAGE -vf fps={rate.rate:.4g} -crf 14 CONVERTED.mp4"
    return Finding("frame-rate-varies", what, todo, camera)


def interlaced(camera: str) -> Finding:
    """A camera's video of the wand is interlaced."""
    what = "its video of the wand is interlaced: on each frame, what moves is in two places"
    todo = "separate its fields, as with: ffmpeg -i FOOTAGE -vf bwdif=mode=send_field -crf 14 CONVERTED.mp4"
    return Finding("interlaced", what, todo, camera)


def offset_vague(camera: str, sigma: float) -> Finding:
    """The time offset of a camera is uncertain."""
    what = f"its time offset is known only to {sigma:.2f} frames"
    return Finding("offset-vague", what, "wave the wand faster, in all directions", camera)


def focal_vague(camera: str, share: float) -> Finding:
    """The focal length of a camera is uncertain."""
    what = f"its focal length is known only to {share:.1%}"
    todo = "wave the wand nearer to this camera and farther from it, or give its 'focal' or 'matrix'"
    return Finding("focal-length-vague", what, todo, camera)


def little_covered(camera: str, share: float) -> Finding:
    """The wand covered little of a camera's picture."""
    what = f"the wand was seen in only {share:.0%} of its picture; distortion elsewhere is a guess"
    return Finding("picture-little-covered", what, "wave the wand through all of the picture, to its corners", camera)


def noisy(times: float) -> Finding:
    """The residuals are larger than the balls' noise explains."""
    what = f"the balls lie {times:.1f} times as far from their places as they should"
    todo = "see that nobody moved a camera, that fps and offsets are right, and that the balls are detected well"
    return Finding("noise-high", what, todo)


def nothing_agrees() -> Finding:
    """No set of cameras agrees with the observations."""
    todo = (
        "see that the wand's length, the offsets and the colours are right and that cameras do not all stand side by "
        "side, and look at the detected points"
    )
    return Finding("no-solution", "no set of cameras was found that agrees with what they see of the wand", todo)
