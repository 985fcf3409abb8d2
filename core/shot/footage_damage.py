"""Damage that a decoder finds in a video: it hands out the frames all the same."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from ..errors import listed
from ..runtime.decoder_log import DecoderLog
from .frame_numbers import file_index
from .image_sequences import image_files
from .shot import Shot, View

_SHOWN = 5


@dataclass(frozen=True)
class FootageDamage:
    """What the decoder of a view's footage found wrong.

    Attributes
    ----------
    frames : tuple of int
        Frames of the file at which it said so; where it decodes some frames ahead they are just before the damage.
    said : str
        What it said first.
    """

    frames: tuple[int, ...]
    said: str

    @property
    def text(self) -> str:
        """Say where the footage is damaged, what that does, and what to do."""
        return (
            f"the footage is damaged at or near frames {listed(self.frames, _SHOWN)} of the file ({self.said}); "
            "pictures from there on may be wrong and mislead the tracking: copy the file from the camera again, or "
            "leave the camera out"
        )


def shot_damage(shot: Shot) -> tuple[FootageDamage | None, ...]:
    """What the decoder finds wrong with the footage of every view; see `footage_damage`."""
    return tuple(footage_damage(shot, view) for view in shot.views)


def footage_damage(shot: Shot, view: View) -> FootageDamage | None:
    """Decode the footage of a view up to the shot's last frame, and return what is wrong with it; None if nothing is.

    It takes as long as decoding does: ask when `DecoderLog` has caught a complaint of any view. No other footage may be
    decoded meanwhile.
    """
    if not view.footage.is_file() or image_files(view.footage) is not None:
        return None
    last = file_index(view, shot.frames[-1])
    frames: list[int] = []
    said: list[str] = []
    with DecoderLog() as log:
        # One thread decodes no frame ahead of the one that it hands out, but for frames that are stored in other order.
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
