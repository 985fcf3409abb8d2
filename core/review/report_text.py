"""The report on a tracked shot in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import listed
from ..fitting.checks.misfit_causes import common_shift
from ..shot.footage_faults.footage_checks import SAME_RATE
from ..shot.footage_faults.footage_damage import FootageDamage
from ..shot.footage_faults.footage_times import FootageRate
from ..shot.footage_faults.frame_pattern import FramePattern
from ..shot.frame_numbers import footage_offset_text
from ..tracking.footage_corrections.footage_gaps import FoundGap
from ..tracking.results.late_views import LateView
from .pretracking_warnings import exchanged_text, first_row_text, key_rate_text

_MAX_LISTED = 10
_MIN_AGREEMENT = 0.45
"""Share of a view's keypoints that agree from which nothing is said: see docs/keypoints.md."""
_SHOWN_DRIFT = 0.5
"""Frames by which two views may drift apart over a shot before something is said."""
_PEOPLE, _USUAL_HEIGHT = (1.0, 2.3), 1.7
"""Heights of people, children included, beyond which the unit of a calibration is doubted, and a usual one, metres."""
_SAME_HEIGHT = 0.15
"""Logarithm of a ratio up to which the height of the limbs can be that of the person."""
_RATE_TOLERANCE = 5e-4  # 29.97 and 30 frames per second differ by twice as much

CAMERA_FITS = ("keypoints", "key poses")
"""What cameras are compared with that may be refined."""
_CAMERA_INSTEAD = (
    "; but this camera is off, which may look so: refine the cameras first, or write correct_gaps = false under [track]"
)
_OFFSET_INSTEAD = (
    "; but an offset is wrong (see above), which may look so: correct that first, or write correct_gaps = false under "
    "[track]"
)
NO_KEYPOINTS_TEXT = (
    "its keypoint files show no performer on the shot's frames: check that they are of this footage, and that their "
    "frame numbers count from 0, as the frames of the footage"
)


def report_lines(values: Mapping[str, Any]) -> list[str]:
    """Return a report as lines of text: problems of the footage, hidden parts, and suggested key poses."""
    lines = [f"left out, {file}" for view in values["views"] for file in view["skipped"]]
    offset = values["footage_offset"]
    if offset and values["settings"]["footage_offset"] is None:
        lines.append(footage_offset_text(offset))
    for view in values["views"]:
        if view["refined"]:
            lines.append(f"{view['camera']}: refined, its picture moved by {view['refined']['shift']:.1f} px")
    if values["world"]:
        lines.append(f"{values['world']}: if so, state it as up under [calibration]")
    off = [(view["camera"], fit) for view in values["views"] for fit in view["fits"] if fit["off"]]
    lines += [f"{fit['summary']}{offset_text(camera, fit.get('offset'))}" for camera, fit in off]
    lines += _shifted_together(values["views"])
    if any(fit["by"] in CAMERA_FITS for _, fit in off):
        lines.append(
            "if their offsets are right, refine the cameras: kfmocap track --refine, or Refine Cameras in Blender"
        )
    lines += _footage_lines(values)
    for performer in values["performers"]:
        if text := key_rate_text(performer.get("file_fps", 0.0), values["fps"]):
            lines.append(f"{performer['name']}: {text}")
        if text := first_row_text(performer.get("file_rows", 0), values["frames"]):
            lines.append(f"{performer['name']}: {text}")
        if text := exchanged_text(performer.get("exchanged_keyframes", ())):
            lines.append(f"{performer['name']}: {text}")
        lines += [f"{performer['name']}: {line}" for line in _performer_lines(performer)]
    return lines


def _shifted_together(views: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line that the key poses may be counted from another frame, if all views fit them better by the same
    number of frames earlier or later.
    """
    shifts = [
        (fit["offset"] - view["offset"]) / view.get("every", 1)
        for view in views
        for fit in view["fits"]
        if fit["off"] and fit.get("offset") is not None
    ]
    shift = common_shift(shifts, len(views))
    if len(views) < 2 or shift is None:
        return []
    return [
        f"all views fit better by about {abs(shift):.0f} frames: rather than the offsets, check the key poses: "
        "whether key frames are counted from 0, and which frame the first row of their file shows (first_row of a "
        "[[performer]])"
    ]


def offset_text(camera: str, offset: float | None) -> str:
    """Return how to take an offset that fits better, as the end of a sentence; empty if none is known."""
    return "" if offset is None else f": write it into the [[view]], or track with --offset {camera}={offset:g}"


def _performer_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return the report's lines on a performer."""
    return [
        *_keypoint_lines(performer),
        *_size_lines(performer),
        *_hidden_lines(performer),
        *_acceleration_lines(performer),
        *_key_pose_lines(performer),
    ]


def _keypoint_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return lines on whom the keypoints show, and how well they agree."""
    lines = [
        f"of its keypoints in {camera}, {text}"
        for camera, own in performer.get("keypoints", {}).items()
        if own["frames"] and (text := keypoints_text(own["agreement"]))
    ]
    if identity := performer.get("identity", {}).get("text"):
        lines.append(identity)
    if performer["lifted"]:
        lines.append(
            "only one camera shows it: depths are estimated from the lengths of the bones, and may be decimetres off; "
            "key poses correct them"
        )
    return lines


def _size_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return lines on a size that no person has, or that contradicts the height that was given."""
    lines = []
    by_keypoints = len(performer["proposed_keyframes"]) == len(performer["keyframes"])
    if by_keypoints and (size := performer.get("size")) and not _PEOPLE[0] <= size <= _PEOPLE[1]:
        lines.append(
            f"by the calibration it is {size:g} m tall: if it is a person, state the calibration's unit, or multiply "
            f"its translations by {_USUAL_HEIGHT / size:.2g}"
        )
    if (heights := performer.get("heights")) and abs(np.log(heights["limbs"] / heights["given"])) > _SAME_HEIGHT:
        given, limbs = heights["given"], heights["limbs"]
        lines.append(
            f"a height of {given:g} m was given, but its limbs are those of a person of {limbs:g} m: if the height is "
            f"right, all lengths are wrong by a factor of {limbs / given:.2g}, as with a calibration in another unit "
            "or a wand of another length"
        )
    return lines


def _hidden_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return lines on parts that nothing shows, and on frames on which no camera sees a part."""
    lines = []
    if unknown := ", ".join(performer["unknown"]):
        lines.append(f"unknown, as no key pose, keypoint or camera shows them: {unknown}")
    counts = [f"{part} {sum(b + 1 - a for a, b in spans)}" for part, spans in performer["unseen"].items()]
    if counts:
        lines.append(f"frames on which no camera sees a part: {', '.join(counts)}")
    return lines


def _acceleration_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return a line on the accelerations that were found, if they were estimated."""
    found = performer.get("accelerations")
    if not found:
        return []
    slow, *_, fast = sorted(found["joints"].items(), key=lambda item: item[1])
    return [
        f"typical accelerations found: root {found['root']:.1f} m/s^2, joints {slow[1]:.0f} ({slow[0]}) to "
        f"{fast[1]:.0f} rad/s^2 ({fast[0]})"
    ]


def _key_pose_lines(performer: Mapping[str, Any]) -> list[str]:
    """Return lines on what may be lost, and on frames where another key pose would help."""
    lines = []
    whole = {"the whole body": performer["body_may_be_lost"]} if performer["body_may_be_lost"] else {}
    each = (whole | performer["may_be_lost"]).items()
    lost = [f"{part} {', '.join(f'{a}-{b}' for a, b in spans)}" for part, spans in each]
    if lost:
        lines.append(
            f"may be lost, or hidden by something, as the footage does not show them where they are: {'; '.join(lost)}"
        )
    helpful = [
        f"{key['frame']} ({' '.join(key['parts'])} some {key['worst_error']:.0f} mm)"
        for key in performer["helpful_keyframes"]
    ]
    if helpful:
        lines.append(f"where one more key pose would help most: {', '.join(helpful)}")
    suggested = [
        f"{s['frame']} ({' '.join(s['parts'])} hidden {s['hidden'][0]}-{s['hidden'][1]})"
        for s in performer["suggested_keyframes"]
    ]
    if suggested:
        lines.append(f"key poses would help at {', '.join(suggested)}")
    return lines


def _footage_lines(values: Mapping[str, Any]) -> list[str]:
    """Return lines on problems of the views' footage."""
    lines = []
    misplaced = any(fit.get("offset") is not None for view in values["views"] for fit in view["fits"])
    for view in values["views"]:
        rate, every = view["footage_fps"], view.get("every", 1)
        found = FootageRate(**view["rate"]) if view.get("rate") else None
        if found is not None and found.varies:
            lines.append(f"{view['camera']}: {found.text(values['fps'] * every)}")
        elif text := rate_text(rate, found, every, values["fps"], values["frames"][1] - values["frames"][0] + 1):
            lines.append(f"{view['camera']}: {text}; if its own is right, write it as fps under [shot]")
        seen = [
            own[view["camera"]]["frames"] for performer in values["performers"] if (own := performer.get("keypoints"))
        ]
        if view.get("keypoints") and seen and not any(seen):
            lines.append(f"{view['camera']}: {NO_KEYPOINTS_TEXT}")
        if off := view.get("keypoint_frames_off"):
            lines.append(f"{view['camera']}: {keypoint_numbers_text(off)}")
        pattern = FramePattern(**(view.get("pattern") or {}))
        if pattern.text:
            lines.append(f"{view['camera']}: {pattern.text}")
        if view.get("damage"):
            lines.append(f"{view['camera']}: {FootageDamage(**view['damage']).text}")
        if view["torn"] and not pattern.every:
            lines.append(f"{view['camera']}: {torn_text(view['torn'])}")
        gaps = [FoundGap(**gap) for gap in view.get("gaps", ())]
        refinable = any(fit["off"] and fit["by"] in CAMERA_FITS for fit in view["fits"])
        doubt = _OFFSET_INSTEAD if misplaced else _CAMERA_INSTEAD if refinable else ""
        lines += [f"{view['camera']}: {gap.text}{doubt}" for gap in gaps if not (gap.timed or gap.given)]
        if view.get("late"):
            lines.append(f"{view['camera']}: {LateView(**view['late']).text}{doubt}")
    return lines + _drift_lines(values)


def _drift_lines(values: Mapping[str, Any]) -> list[str]:
    """Return a line on the two views whose constant frame rates differ most, if this shows before the shot ends.

    Rates that differ by more than `SAME_RATE` are those of footage whose frames were said to be the shot's one by one.
    """
    timed = [(view, FootageRate(**view["rate"])) for view in values["views"] if view.get("rate")]
    rates = {view["camera"]: found.rate / view.get("every", 1) for view, found in timed if not found.varies}
    if len(rates) < 2:
        return []
    slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
    first, last = values["frames"]
    apart = (last - first) * (1 - rates[slow] / rates[fast])
    if apart < _SHOWN_DRIFT or rates[fast] > rates[slow] * (1 + SAME_RATE):
        return []
    return [
        f"by the times in their files, {slow} has {rates[slow]:.5g} frames per second and {fast} {rates[fast]:.5g}: "
        f"if that is right, they are {apart:.1f} frames apart at the end; convert {fast}, as with: "
        f"ffmpeg -i FOOTAGE -vf fps={rates[slow]:.5g} -crf 14 CONVERTED.mp4"
    ]


def keypoints_text(agreement: float) -> str:
    """Return a text that says that most of a view's keypoints contradict the other views, and what to check; empty if
    they do not.
    """
    if agreement >= _MIN_AGREEMENT:
        return ""
    return (
        f"{1 - agreement:.0%} contradict the other views or the motion: check that they are of this footage and this "
        "person, and that its offset is right"
    )


def keypoint_numbers_text(off: float) -> str:
    """Return a text that keypoints belong to pictures some frames after theirs, or before if negative."""
    when, way = ("before", "high") if off < 0 else ("after", "low")
    return (
        f"its keypoints move as what its pictures show {abs(off):.1f} frames {when} them: their frame numbers seem to "
        f"be too {way} by {round(abs(off))} (they count from 0, as the frames of the footage), or the detector saw "
        "another file"
    )


def rate_text(stated: float, found: FootageRate | None, every: int, fps: float, frames: int) -> str:
    """Return a text that footage has another frame rate than its shot; empty if it has not, or states none (0).

    The rate is that of the times of its frames, if it is constant: a phone's file states the mean over the whole file,
    in which the last frame may last longer. With few frames, the errors of their times hide a small difference.

    Parameters
    ----------
    stated : float
        Frames per second, as the file states them.
    found : FootageRate, optional
        By the times of its frames.
    every : int
        Number of the footage's frames for each of the shot.
    fps, frames : float, int
        The shot's frames per second, and their number.
    """
    steady = found is not None and not found.varies
    rate = (round(found.rate, 3) if found is not None and steady else stated) / every
    hidden = found.astray / every / frames if found is not None and steady else 0.0
    if not rate or abs(rate - fps) <= max(_RATE_TOLERANCE, hidden) * rate:
        return ""
    return f"its footage has {rate:g} frames per second, the shot {fps:g}"


def torn_text(frames: Sequence[int]) -> str:
    """Return a text that names the frames of a view which do not continue the one before."""
    shown = listed(frames, _MAX_LISTED)
    return (
        "pictures that do not continue from the one before (frames that are damaged, repeated or missing, or a change "
        f"of light) were given no weight: on or before frames {shown}; if frames are missing, all that follow are "
        "early in this view; where motion is very fast or very slight, pictures alone do not show it"
    )
