"""The report of a tracking job (report.json): what was done, how long it took, and which results are doubtful."""

from __future__ import annotations

import dataclasses
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from ..body.body_size import body_size
from ..body.measures.measures_from_landmarks import limb_height
from ..body.soles import Soles
from ..cameras.world_axes import upward_axis_warning
from ..evidence.occlusion import OCCLUDED_BELOW, intervals, occluded, unseen
from ..numerics.arrays import Bools
from ..runtime.program_version import program_version
from ..shot.footage import container_rate
from ..shot.footage_faults.footage_damage import FootageDamage
from ..shot.footage_faults.footage_times import FootageRate
from ..shot.footage_faults.frame_pattern import FramePattern
from ..shot.shot import Performer, Shot
from ..tracking.expected_errors.uncertainty import expected_errors, joint_parts
from ..tracking.footage_corrections.footage_gaps import found_gaps, torn_frames
from .pretracking_warnings import exchanged_keyframes
from .suggestions import suggest_keys_beside_hidden, suggest_keys_by_error

if TYPE_CHECKING:
    from ..fitting.camera_fits.camera_refinement import RefinedCamera, Refinement
    from ..fitting.checks.view_findings import ViewFinding
    from ..keypoints.observations import PerformerKeypoints
    from ..tracking.expected_errors.uncertainty import JointErrors
    from ..tracking.results.track_result import TrackResult

WORST_FRAMES = 10
"""Number of frames that are listed as the worst."""


def report(
    shot: Shot,
    result: TrackResult,
    seconds: Mapping[str, float] | None = None,
    *,
    fits: Sequence[ViewFinding] = (),
    refined: Refinement | None = None,
) -> dict[str, Any]:
    """Summarise a tracking job as plain values for JSON.

    Parameters
    ----------
    shot : Shot
    result : TrackResult
    seconds : mapping, optional
        Seconds of further stages, beside those of `result`.
    fits : sequence of ViewFinding
        How well those cameras fit that were compared.
    refined : Refinement, optional
        How the cameras were refined before tracking, if they were.

    Returns
    -------
    dict
        Frame numbers in it are those of the shot file.
    """
    stages = {**result.seconds, **(seconds or {})}
    tracking = sum(result.seconds.values())
    return {
        "shot": shot.name,
        "frames": list(shot.frames),
        "fps": shot.fps,
        "seconds": {stage: round(value, 3) for stage, value in stages.items()},
        "seconds_total": round(sum(stages.values()), 3),
        "camera_frames": result.camera_frames,
        "camera_frames_per_second": round(result.camera_frames / tracking, 2) if tracking > 0 else None,
        "segments": [
            {
                "frames": [shot.frames[0] + segment.first, shot.frames[0] + segment.last],
                "iterations": segment.iterations,
                "energy": [float(e) if np.isfinite(e) else None for e in segment.energy],
            }
            for segment in result.segments
        ],
        "footage_offset": round(result.footage_offset, 3),
        "world": upward_axis_warning([view.camera for view in shot.views]),
        "performers": [_performer_values(shot, result, i) for i in range(len(shot.performers))],
        "settings": dataclasses.asdict(shot.settings),
        "views": [
            _view_values(shot, result, v)
            | {
                "fits": [_finding(fit) for fit in fits if fit.camera == view.camera.name],
                "refined": None if refined is None else _refined_camera(refined.views[v]),
            }
            for v, view in enumerate(shot.views)
        ],
        "versions": _versions(),
    }


def _view_values(shot: Shot, result: TrackResult, number: int) -> dict[str, Any]:
    """Return the report on a view and its footage."""
    view = shot.views[number]
    return {
        "camera": view.camera.name,
        "footage": str(view.footage),
        "size": list(view.camera.size),
        "offset": view.offset,
        "fields": view.fields,
        "every": view.every,
        "keypoints": str(view.keypoints) if view.keypoints else None,
        "footage_fps": container_rate(view),
        "rate": _of_view(result.rates, number),
        "torn": [shot.frames[0] + frame for frame in torn_frames(shot, result)[number]] if result.torn else [],
        "gaps": [dataclasses.asdict(gap) for gap in found_gaps(shot, result)[number]],
        "late": _late(shot, result, number),
        "pattern": _of_view(result.patterns, number),
        "damage": _of_view(result.damage, number),
        "keypoint_frames_off": _of_keypoints(result.observed.frames_off, number),
        "skipped": list(result.observed.skipped[number]) if result.observed.skipped else [],
    }


def _of_keypoints(off: Sequence[float | None], view: int) -> float | None:
    """Return by how many frames a view's keypoints are off, if they are."""
    own = off[view] if off else None
    return None if own is None else round(own, 1)


def _late(shot: Shot, result: TrackResult, view: int) -> dict[str, Any] | None:
    """Return from which frame on a view is early or late; None if it is not."""
    own = result.late[view] if result.late else None
    return None if own is None else dataclasses.asdict(own.counted_from(shot.frames[0]))


def _performer_values(shot: Shot, result: TrackResult, number: int) -> dict[str, Any]:
    """Return the report on a performer."""
    performer, unknown = shot.performers[number], result.unknown[number]
    observed = result.observed.performers[number] if result.observed.performers else None
    return (
        _performer(shot, performer, result.visible[number], result.residual[number], unknown)
        | _accelerations(performer, [s.accelerations[number] for s in result.segments if s.accelerations])
        | _expected_errors(shot, performer, result.errors[number], unknown)
        | _plants(shot, performer, result.planted[number] if result.planted else None)
        | ({} if observed is None else _observed(shot, observed))
        | {"lifted": observed is not None and observed.is_lifted}
    )


def _of_view(found: Sequence[FootageRate | FootageDamage | FramePattern | None], view: int) -> dict[str, Any] | None:
    """Return a view's rate, damage or pattern as plain values; None if there is none, or it was not looked for."""
    own = found[view] if found else None
    return None if own is None else dataclasses.asdict(own)


def _performer(
    shot: Shot,
    performer: Performer,
    visible: NDArray[np.float64],
    residual: NDArray[np.float64],
    unknown: Sequence[str],
) -> dict[str, Any]:
    first = shot.frames[0]
    worst = [int(f) for f in np.argsort(-np.nan_to_num(residual, nan=-1.0), kind="stable") if residual[f] >= 0]
    names = performer.body.names
    blind = unseen(visible) & ~np.isin(names, unknown)
    return {
        "name": performer.name,
        "keyframes": [first + int(f) for f in performer.key_poses.frames],
        "file_fps": round(performer.file_fps, 3),
        "file_rows": performer.file_rows,
        "size": round(body_size(performer.body), 2),
        "heights": _heights(performer),
        "exchanged_keyframes": exchanged_keyframes(shot, performer),
        "proposed_keyframes": [first + int(f) for f in performer.key_poses.proposals()],
        "occluded_below": OCCLUDED_BELOW,
        "occluded": {
            view.camera.name: _spans(names, hidden & ~np.isin(names, unknown), first)
            for view, hidden in zip(shot.views, occluded(visible), strict=True)
        },
        "unknown": list(unknown),
        "unseen": _spans(names, blind, first),
        "suggested_keyframes": [
            {
                "frame": first + suggestion.frame,
                "parts": [names[p] for p in suggestion.parts],
                "hidden": [first + f for f in suggestion.hidden or ()],
            }
            for suggestion in suggest_keys_beside_hidden(blind, performer.key_poses)
        ],
        "worst_frames": [{"frame": first + f, "residual": float(residual[f])} for f in worst[:WORST_FRAMES]],
    }


def _heights(performer: Performer) -> dict[str, float] | None:
    """Return the height that was given and that of the limbs, metres; None if either is not known."""
    given, limbs = performer.given_height, limb_height(performer.body)
    return None if given is None or limbs is None else {"given": given, "limbs": round(limbs, 2)}


def _expected_errors(shot: Shot, performer: Performer, errors: JointErrors, unknown: Sequence[str]) -> dict[str, Any]:
    """Return the joints' expected errors in millimetres, where parts may be lost, and the suggested key frames."""
    first, names, parents = shot.frames[0], performer.body.names, performer.body.parents
    left_out = [names.index(name) for name in unknown]
    joints = joint_parts(parents, left_out)
    mean, interval = (expected_errors(values, parents, left_out) for values in (errors.deviation, errors.interval))
    return {
        "expected_error": [round(1000 * float(value), 1) for value in mean],
        "expected_error_90": [round(1000 * float(value), 1) for value in interval],
        "joint_errors_90": {
            names[part]: [round(1000 * float(value), 1) for value in errors.interval[:, part]] for part in joints
        },
        "body_may_be_lost": intervals(errors.body_maybe_lost(), first),
        "may_be_lost": _spans(names, errors.parts_maybe_lost(), first),
        "helpful_keyframes": [
            {
                "frame": first + key.frame,
                "expected_error": round(1000 * key.deviation, 1),
                "worst_error": round(1000 * key.worst, 1),
                "gain": round(1000 * key.gain, 2),
                "parts": [names[part] for part in key.parts],
            }
            for key in suggest_keys_by_error(errors.deviation, performer.key_poses, parents, left_out)
        ],
    }


def _plants(shot: Shot, performer: Performer, planted: Bools | None) -> dict[str, Any]:
    """Return first and last frame of each plant that was held, by point of the soles; empty if none was tested."""
    soles = Soles.of(performer.body)
    if planted is None or soles is None:
        return {}
    return {"plants": {name: intervals(planted[:, c], shot.frames[0]) for c, name in enumerate(soles.names)}}


def _observed(shot: Shot, own: PerformerKeypoints) -> dict[str, Any]:
    """Return which of the detected people a performer is, and its keypoints."""
    return {
        "identity": {**dataclasses.asdict(own.identity), "text": str(own.identity)},
        "keypoints": _keypoints(shot, own),
    }


def _keypoints(shot: Shot, own: PerformerKeypoints) -> dict[str, Any]:
    """Return for each view on how many frames a performer's keypoints were found, how well they agree with the other
    views, and where left and right were exchanged.
    """
    keypoints, agreements = own.factor.keypoints, own.agreements()
    return {
        view.camera.name: {
            "frames": int(keypoints.confidence[v].any(axis=1).sum()),
            "agreement": round(agreements[v] or 0.0, 3),
            "sides_changed": intervals(own.changed[v].any(axis=1), shot.frames[0]),
        }
        for v, view in enumerate(shot.views)
    }


def _finding(found: ViewFinding) -> dict[str, Any]:
    """Return how well a view's camera fits, in pixels, or what else was found about it."""
    return {"by": found.by, "off": found.off, **found.figures, "summary": found.summary}


def _refined_camera(found: RefinedCamera) -> dict[str, Any]:
    """Return how a camera was refined, in pixels; the deviation is None if nothing determined it."""
    deviation = round(found.deviation, 1) if np.isfinite(found.deviation) else None
    return {"shift": round(found.shift, 1), "deviation": deviation, "lost": found.lost}


def _accelerations(performer: Performer, found: list[NDArray[np.float64]]) -> dict[str, Any]:
    """Return the medians of the accelerations that were estimated on the segments; of the root, all axes together."""
    if not found:
        return {}
    across, up, *joints = np.median(found, axis=0)
    root = np.sqrt((2 * across**2 + up**2) / 3)
    turns = {part.name: round(float(value), 1) for part, value in zip(performer.body.parts, joints, strict=True)}
    return {"accelerations": {"root": round(float(root), 2), "joints": turns}}


def _spans(names: list[str], hidden: NDArray[np.bool_], first: int) -> dict[str, list[list[int]]]:
    """Return by part the intervals in which it is hidden (F, P), as shot frames; the first row is frame `first`."""
    spans = {name: intervals(hidden[:, p], first) for p, name in enumerate(names)}
    return {name: found for name, found in spans.items() if found}


def _versions() -> dict[str, str]:
    return {
        "kfmocap": program_version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
    }
