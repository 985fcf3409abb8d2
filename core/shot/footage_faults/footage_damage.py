"""Damage that a decoder finds in a video, whose frames it returns nevertheless."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from ...errors import listed
from ...runtime.decoder_log import DecoderLog
from ..frame_numbers import file_index
from ..image_sequences import image_files
from ..shot import Shot, View

_SHOWN = 5


@dataclass(frozen=True)
class FootageDamage:
    """The damage that the decoder of a view's footage reported: on which frames of the file, and its first message.

    The frames are those being read at the time: at the damage, or just before it if the decoder reads ahead.
    """

    frames: tuple[int, ...]
    said: str

    @property
    def text(self) -> str:
        """Message on where the footage is damaged, what that affects, and what to do."""
        return (
            f"the footage is damaged at or near frames {listed(self.frames, _SHOWN)} of the file ({self.said}); "
            "pictures from there on may be wrong and mislead the tracking: copy the file from the camera again, or "
            "leave the camera out"
        )


def shot_damage(shot: Shot) -> tuple[FootageDamage | None, ...]:
    """Return the damage of every view's footage; see `footage_damage`."""
    return tuple(footage_damage(shot, view) for view in shot.views)


def footage_damage(shot: Shot, view: View) -> FootageDamage | None:
    """Decode the footage of a view up to the shot's last frame, and return its damage; None if there is none.

    As this decodes everything again, call it only if `DecoderLog` has caught a complaint, and while no other footage is
    being decoded.
    """
    if not view.footage.is_file() or image_files(view.footage) is not None:
        return None
    last = file_index(view, shot.frames[-1])
    frames: list[int] = []
    said: list[str] = []
    with DecoderLog() as log:
        # A single thread reads no frames ahead, except for those stored in another order.
        video = cv2.VideoCapture(str(view.footage), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        try:
            for number in range(last + 1):
                going = video.grab()
                if new := log.new():
                    frames.append(number)
                    said += new
                if not going:
                    break
        finally:
            video.release()
    return FootageDamage(tuple(frames), said[0]) if frames else None
