"""The JSON documents of pose detectors, recognised by their content, as lists of people.

Supported are OpenPose (`people`), COCO's results and annotations, AlphaPose (COCO's results with names of pictures, or
`bodies` by name), MMPose and RTMPose (`instances`, alone or with `instance_info`), MediaPipe (landmarks as `x`, `y`,
`visibility`) and Ultralytics' YOLO-pose (`keypoints` of lists `x`, `y`, `visible`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from .keypoint_layouts import HAND_POINTS, landmark_of

_HAND = 3 * len(HAND_POINTS)


@dataclass(frozen=True)
class DetectedPerson:
    """One person in one picture.

    Attributes
    ----------
    values : sequence of float
        x, y, confidence of every keypoint, one after the other.
    frame : int or None
        None if the document does not state it, because it is about one picture.
    track : int
        The detector's number of the person; -1 if there is none.
    normalised : bool
        Whether coordinates are fractions of the picture's width and height, 0 to 1 from edge to edge.
    names : tuple of str or None
        Names of the keypoints (`core.formats.keypoint_layouts`), if the document has names.
    hands : sequence of float
        x, y, confidence of the 42 points of both hands, if the document lists them separately from the body's.
    picture : str or None
        Name of the picture's file, if the document states it; `frame` is then the last number in it.
    """

    values: Sequence[float]
    frame: int | None = None
    track: int = -1
    normalised: bool = False
    names: tuple[str, ...] | None = None
    hands: Sequence[float] = ()
    picture: str | None = None


def people(document: Any) -> list[DetectedPerson] | None:
    """Return all people of a document, or None if its format is unknown.

    Raises
    ------
    KeyError, TypeError, ValueError, IndexError, AttributeError
        The format is known, but the document is incomplete.
    """
    if isinstance(document, Mapping):
        return _of_mapping(document)
    if isinstance(document, list):
        return _of_list(document)
    return None


def _of_mapping(document: Mapping[str, Any]) -> list[DetectedPerson] | None:
    if "people" in document:
        return [_openpose(person) for person in document["people"] if person["pose_keypoints_2d"]]
    if "bodies" in document:
        return [DetectedPerson(body["joints"]) for body in document["bodies"]]
    if "annotations" in document:
        return _annotations(document)
    if "instance_info" in document:
        return _mmpose_video(document["instance_info"], _described_names(document.get("meta_info", {})))
    if "instances" in document:
        return [_mmpose(one, None) for one in document["instances"]]
    for key in ("frames", "results", "predictions"):
        if isinstance(document.get(key), list):
            return _of_list(document[key])
    if (bodies := _mediapipe_bodies(document)) is not None:
        return bodies
    if document and all(isinstance(value, Mapping) for value in document.values()):
        return _by_picture(document)
    return None


def _of_list(document: list[Any]) -> list[DetectedPerson] | None:
    if not document:
        return []
    first = document[0]
    if isinstance(first, Mapping):
        if "image_id" in first:
            return [_coco(entry, entry["image_id"]) for entry in document]
        if "instances" in first:
            return _mmpose_video(document, None)
        if "keypoint_scores" in first:
            return [_mmpose(one, None) for one in document]
        if isinstance(first.get("keypoints"), Mapping):
            return [_ultralytics(one) for one in document]
        if _is_landmark(first):
            return [_mediapipe(document, None)]
    if _is_mediapipe_frame(first):
        return list(_mediapipe_frames(document))
    return None


def picture_number(name: Any) -> int:
    """Return the number of a picture: the last number in its name, or the number that stands for one."""
    if isinstance(name, int):
        return name
    if isinstance(name, float):  # as a name, 1e16 would be picture 16
        if not name.is_integer():
            raise ValueError(f"picture {name} has no whole number")
        return int(name)
    numbers = re.findall(r"\d+", re.sub(r"\.\w*$", "", str(name)))
    if not numbers:
        raise ValueError(f"picture '{name}' has no number")
    return int(numbers[-1])


def _openpose(person: Mapping[str, Any]) -> DetectedPerson:
    track = person.get("person_id") or [-1]
    hands = [v for side in ("left", "right") for v in person.get(f"hand_{side}_keypoints_2d") or [0.0] * _HAND]
    number = int(track[0] if isinstance(track, list) else track)
    return DetectedPerson(person["pose_keypoints_2d"], None, number, hands=hands if any(hands) else ())


def _by_picture(document: Mapping[str, Any]) -> list[DetectedPerson] | None:
    found = []
    for name, inner in document.items():
        for person in _of_mapping(inner) or ():
            found.append(replace(person, frame=picture_number(name), picture=name))
    return found or None


def _coco(entry: Mapping[str, Any], picture: Any) -> DetectedPerson:
    """Read a person in a picture that is called by a name or a number."""
    track, name = entry.get("track_id", entry.get("idx", -1)), picture if isinstance(picture, str) else None
    number = track if isinstance(track, int) else -1
    return DetectedPerson(entry["keypoints"], picture_number(picture), number, picture=name)


def _annotations(document: Mapping[str, Any]) -> list[DetectedPerson]:
    """Read COCO's ground truth: visibility is 0, 1 (hidden) or 2; frame numbers are those in the pictures' names, if
    any.
    """
    names = {image["id"]: image.get("file_name", image["id"]) for image in document.get("images", ())}
    found = []
    for entry in document["annotations"]:
        values = list(entry["keypoints"])
        values[2::3] = [v / 2 for v in values[2::3]]
        found.append(_coco({**entry, "keypoints": values}, names.get(entry["image_id"], entry["image_id"])))
    return found


def _described_names(meta: Mapping[str, Any]) -> tuple[str, ...] | None:
    names = meta.get("keypoint_id2name")
    if isinstance(names, Mapping):
        names = [names[key] for key in sorted(names, key=int)]
    return tuple(map(landmark_of, names)) if names else None


def _mmpose(one: Mapping[str, Any], frame: int | None, names: tuple[str, ...] | None = None) -> DetectedPerson:
    if any(len(point) != 2 for point in one["keypoints"]):
        raise ValueError("places in a picture have two coordinates, those of a 3D pose do not")
    values = [v for (x, y), c in zip(one["keypoints"], one["keypoint_scores"], strict=True) for v in (x, y, c)]
    track = one.get("track_id", -1)
    return DetectedPerson(values, frame, track if isinstance(track, int) else -1, names=names)


def _mmpose_video(entries: Sequence[Mapping[str, Any]], names: tuple[str, ...] | None) -> list[DetectedPerson]:
    """Read frames by their `frame_id`, which MMPose's demo programs count from 1 and its inferencer from 0."""
    first = min((int(entry["frame_id"]) for entry in entries), default=0)
    start = 1 if first >= 1 and names is not None else 0
    return [_mmpose(one, int(entry["frame_id"]) - start, names) for entry in entries for one in entry["instances"]]


def _ultralytics(one: Mapping[str, Any]) -> DetectedPerson:
    points = one["keypoints"]
    seen = points.get("visible") or [1.0] * len(points["x"])
    values = [v for row in zip(points["x"], points["y"], seen, strict=True) for v in row]
    return DetectedPerson(values, track=int(one.get("track_id", -1)))


def _is_landmark(value: Any) -> bool:
    return isinstance(value, Mapping) and "x" in value and "y" in value


def _is_mediapipe_frame(value: Any) -> bool:
    """Whether a value is one picture's landmarks: a list of them, a list of such lists, or a table with such a list."""
    if value is None:
        return True
    if isinstance(value, Mapping):
        return _mediapipe_bodies(value) is not None
    return isinstance(value, list) and (not value or _is_landmark(value[0]) or _is_mediapipe_frame(value[0]))


def _mediapipe_bodies(document: Mapping[str, Any]) -> list[DetectedPerson] | None:
    for key in ("pose_landmarks", "poseLandmarks", "landmarks", "landmark"):
        if key in document:
            frame = document.get("frame", document.get("frame_id"))
            found = list(_mediapipe_picture(document[key], None if frame is None else int(frame)))
            # MediaPipe Holistic, which finds hands, finds only one person.
            return [replace(person, hands=_mediapipe_hands(document)) for person in found]
    return None


def _mediapipe_hands(document: Mapping[str, Any]) -> list[float]:
    """Return both hands of MediaPipe Holistic; empty if there are none."""
    values: list[float] = []
    for keys in (("left_hand_landmarks", "leftHandLandmarks"), ("right_hand_landmarks", "rightHandLandmarks")):
        found = next((document[key] for key in keys if document.get(key)), None)
        hand = next(iter(_mediapipe_picture(found, None)), None) if found else None
        values += hand.values if hand is not None else [0.0] * _HAND
    return values if any(values) else []


def _mediapipe_frames(document: Sequence[Any]) -> Iterator[DetectedPerson]:
    for number, picture in enumerate(document):
        if isinstance(picture, Mapping):
            for person in _mediapipe_bodies(picture) or ():
                frame = number if person.frame is None else person.frame
                yield replace(person, frame=frame)
        else:
            yield from _mediapipe_picture(picture, number)


def _mediapipe_picture(value: Any, frame: int | None) -> Iterator[DetectedPerson]:
    """Generate the people of a picture, which has one person's landmarks, several people's, or none."""
    if isinstance(value, Mapping):
        value = value["landmark"]
    if value and _is_landmark(value[0]):
        yield _mediapipe(value, frame)
    else:
        for body in value or ():
            yield from _mediapipe_picture(body, frame)


def _mediapipe(landmarks: Sequence[Mapping[str, float]], frame: int | None) -> DetectedPerson:
    values = [v for p in landmarks for v in (p["x"], p["y"], p.get("visibility", 1.0))]
    return DetectedPerson(values, frame, normalised=True)
