"""Damage that a decoder finds in a video, whose frames it returns nevertheless."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, zip_longest

import cv2
import numpy as np

from ...errors import listed
from ...numerics.frame_ranges import adjacent_joined
from ...runtime.decoder_log import DecoderLog
from ..footage_files.image_sequences import image_files
from ..footage_files.stored_frames import stored_frames
from ..frame_numbers import file_index
from ..shot import Shot, View
from .continuity import block_means, lit_differently
from .footage_times import made_from, whole_pictures

_MAX_SHOWN = 5
_CUT = "If the footage is edited, and cut there to another picture, track only frames before the cut, or only after it"
_COPY = "copy the file from the camera again"


@dataclass(frozen=True)
class FootageDamage:
    """The damage of a view's footage.

    Attributes
    ----------
    frames : tuple of int
        Frames of the file that were being read when its decoder reported damage: at it, or just before it if the
        decoder reads ahead. Otherwise the first and the last that may be damaged.
    said : str
        The decoder's first message, or else what shows the damage.
    reported : bool
        Whether the decoder reported it.
    stretches : tuple of (int, int)
        First and last frames of the file between which its pictures are made from damaged ones.
    weighed : bool
        Whether these have weight all the same, as no other view shows what they do.
    """

    frames: tuple[int, ...]
    said: str
    reported: bool = True
    stretches: tuple[tuple[int, int], ...] = ()
    weighed: bool = False

    @property
    def text(self) -> str:
        """Message on where the footage is damaged, what that affects, and what to do."""
        between = listed([f"{first} and {last}" for first, last in self.stretches], _MAX_SHOWN)
        alone = "no other view shows what they should, so they have weight and may mislead the tracking"
        weight = alone if self.weighed else "they were given no weight"
        if not self.reported:
            what = f"its pictures may be damaged between frames {between} of the file, though its decoder does not say"
            return f"{what} so: {self.said}; {weight}: look at them. {_CUT}; else {_COPY}"
        what = f"the footage is damaged at or near frames {listed(self.frames, _MAX_SHOWN)} of the file ({self.said})"
        damaged = f"; its pictures between frames {between} may be wrong: {weight}" if between else ""
        return f"{what}{damaged}; {_COPY}"

    def joined(self, other: FootageDamage | None) -> FootageDamage:
        """Return this damage and other damage of the same footage; what a decoder has reported comes first."""
        if other is None:
            return self
        first, second = (self, other) if self.reported else (other, self)
        frames = {*first.frames, *second.frames} if second.reported else first.frames
        return replace(
            first, frames=tuple(sorted(frames)), stretches=tuple(adjacent_joined((*self.stretches, *other.stretches)))
        )


def shot_damage(
    shot: Shot, torn: Sequence[Sequence[int]] = (), *, reported: bool = True
) -> tuple[FootageDamage | None, ...]:
    """Return the damage of every view's footage.

    Parameters
    ----------
    shot : Shot
    torn : sequence of sequence of int, optional
        Per view: shot frames that do not continue the one before, see `unreported_damage`.
    reported : bool
        Whether the decoder of one of them has reported any, see `footage_damage`.
    """
    found = [footage_damage(shot, view) if reported else None for view in shot.views]
    shown = [unreported_damage(shot, view, own) for view, own in zip(shot.views, torn, strict=False)]
    return tuple(other if own is None else own.joined(other) for own, other in zip_longest(found, shown))


def unreported_damage(shot: Shot, view: View, torn: Sequence[int]) -> FootageDamage | None:
    """Return damage that a view's pictures show where they do not continue to one that is stored whole; None if there
    is none.

    A decoder may not notice a changed bit. All pictures that are made from a wrong one are wrong, too, up to the next
    that is stored whole. Encoders also store one whole where the picture changes, but then sooner than the usual
    interval; and where the light alone has changed, the pictures before were right. A single picture that fits neither
    neighbour, as one that a flash lights, begins no such stretch if another may have, and ends none.
    """
    if not torn:
        return None
    jumps = [file_index(view, shot.frames[0] + frame) for frame in torn]
    whole = whole_pictures(view.footage, max(jumps) + 1)
    apart, stretches, ends = np.diff(whole), [], []
    single = {jump for jump in jumps if jump + 1 in jumps}
    lasting = [jump for jump in jumps if not single & {jump - 1, jump}]
    for before, here in pairwise(whole.tolist()):
        jumped = here in jumps and here - 1 not in single and here - before == apart.max() > 1
        if jumped and not _lit_differently(view, here):
            between = [[jump for jump in some if before < jump < here] for some in (lasting, jumps)]
            stretches.append((min(between[0] or between[1], default=before), here - 1))
            ends.append(here)
    if not ends:
        return None
    fault = (
        f"they do not continue to frame {listed(ends, _MAX_SHOWN)}, which {'are' if ends[1:] else 'is'} stored whole"
    )
    frames = tuple(frame for stretch in stretches for frame in stretch)
    return FootageDamage(frames, fault, reported=False, stretches=tuple(stretches))


def _lit_differently(view: View, frame: int) -> bool:
    """Whether a picture of the file differs from the one before in light alone."""
    near = stored_frames(view.footage, (frame - 1, frame), view.camera.size, threads=1)
    before, after = (block_means(stored.image) for stored in near)
    return lit_differently(before, after)


def footage_damage(shot: Shot, view: View) -> FootageDamage | None:
    """Decode the footage of a view up to the shot's last frame, and return its damage; None if there is none.

    As this decodes everything again, call it only if `DecoderLog` has caught a complaint, and while no other footage is
    being decoded.
    """
    if not view.footage.is_file() or image_files(view.footage) is not None:
        return None
    last = file_index(view, shot.frames[-1])
    frames: list[int] = []
    messages: list[str] = []
    with DecoderLog() as log:
        # A single thread reads no frames ahead, except for those stored in another order.
        video = cv2.VideoCapture(str(view.footage), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        try:
            # It looks at some frames when it opens the file, and says so again when it returns them.
            messages += log.new()
            for number in range(last + 1):
                going = video.grab()
                if new := log.new():
                    frames.append(number)
                    messages += new
                if not going:
                    break
        finally:
            video.release()
    if not messages:
        return None
    stretches = made_from(view.footage, frames, last + 1)
    return FootageDamage(tuple(frames) or (0,), messages[0], stretches=stretches)
