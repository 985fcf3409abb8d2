"""The orders in which detectors list their keypoints, and the names of these keypoints.

Names are those of the body's landmarks (as in Pose2Sim), and a few more of the face; an empty name marks a keypoint
that is not used. An order is recognised by its number of keypoints. If several have the same number, the one that the
detectors' own programs write is used; OpenPose's two orders of 25 are distinguished by the positions of the keypoints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray


def _listed(text: str) -> list[str]:
    return text.split()


COCO_17 = _listed(
    "Nose LEye REye LEar REar LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee LAnkle RAnkle"
)
MPII_16 = _listed("RAnkle RKnee RHip LHip LKnee LAnkle Hip - Neck Head RWrist RElbow RShoulder LShoulder LElbow LWrist")
OPENPOSE_18 = _listed(
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle LHip LKnee LAnkle REye LEye REar LEar"
)
BODY_25 = _listed(
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist Hip RHip RKnee RAnkle LHip LKnee LAnkle "
    "REye LEye REar LEar LBigToe - LHeel RBigToe - RHeel"
)
BODY_25B = [*COCO_17, *_listed("Neck Head LBigToe - LHeel RBigToe - RHeel")]
HALPE_26 = [*COCO_17, *_listed("Head Neck Hip LBigToe RBigToe - - LHeel RHeel")]
MEDIAPIPE_33 = _listed(
    "Nose - LEye - - REye - LEar REar - - LShoulder RShoulder LElbow RElbow LWrist RWrist - - - - - - "
    "LHip RHip LKnee RKnee LAnkle RAnkle LHeel RHeel LBigToe RBigToe"
)


def _hands(first: int, count: int) -> list[str]:
    """Return the rest of a list of names whose last 42 are the hands', 21 each, of which only the tips of the middle
    fingers are used.
    """
    rest = ["-"] * (count - first)
    rest[-42 + 12], rest[-21 + 12] = "LHand", "RHand"
    return rest


HAND_POINTS = (
    "Wrist",
    *(f"{finger}{k}" for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky") for k in range(1, 5)),
)
"""The points of a hand in the order of all supported detectors: the wrist, then each finger from its knuckle (the
thumb from its root) to its tip."""
HAND_NAMES = tuple(f"{side}Hand{point}" for side in "LR" for point in HAND_POINTS)
"""The points of both hands."""
WHOLE_BODY = (133, 136)
"""Lengths of lists that end with the points of both hands, the left hand first."""

COCO_133 = [*COCO_17, *_listed("LBigToe - LHeel RBigToe - RHeel"), *_hands(23, 133)]
HALPE_136 = [*HALPE_26, *_hands(26, 136)]


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple("" if name == "-" else name for name in names)


_LAYOUTS = (MPII_16, COCO_17, OPENPOSE_18, BODY_25, HALPE_26, MEDIAPIPE_33, COCO_133, HALPE_136)
LAYOUTS: Mapping[int, Sequence[str]] = {len(names): _named(names) for names in _LAYOUTS}
"""Names of a detector's keypoints, by the length of its list."""


def keypoint_layout(people: NDArray[np.float64]) -> Sequence[str]:
    """Return the names of the keypoints of people whose lists have the same length.

    OpenPose has two orders of 25 keypoints. In BODY_25, the 16th to 19th are eyes and ears, and a whole arm is among
    the first five; BODY_25B begins with the face, and its 16th to 19th are the ankles, the neck and the top of the
    head.

    Parameters
    ----------
    people : ndarray, shape (n, k, 3)
        x, y, confidence of every keypoint; the confidence is 0 where it was not found.
    """
    count = people.shape[1]
    if count != len(BODY_25B):
        return LAYOUTS[count]
    votes = 2 * _extents(people[:, :5]) - _extents(people[:, 15:19])
    return _named(BODY_25B) if (votes < 0).sum() > (votes > 0).sum() else LAYOUTS[count]


def _extents(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the diagonals of the bounding boxes of people's keypoints (n, k, 3); NaN if fewer than three were
    found.
    """
    found = points[..., 2:] > 0
    lowest = np.where(found, points[..., :2], np.inf).min(axis=1)
    highest = np.where(found, points[..., :2], -np.inf).max(axis=1)
    return np.where(found.sum(axis=(1, 2)) >= 3, np.linalg.norm(highest - lowest, axis=1), np.nan)


_LANDMARK_BY_WORDS = {
    **{name.lower(): name for name in _listed("Nose Eye Ear Shoulder Elbow Wrist Hip Knee Ankle Heel Neck Head")},
    "big toe": "BigToe",
    "foot index": "BigToe",
    "pelvis": "Hip",
    "mid hip": "Hip",
    "root": "Hip",
}


def landmark_of(name: str) -> str:
    """Return the landmark name for a keypoint's name in a file, such as `left_shoulder`; empty if it is not used."""
    words = name.lower().replace("_", " ").split()
    side = {"left": "L", "right": "R"}.get(words[0], "") if words else ""
    landmark = _LANDMARK_BY_WORDS.get(" ".join(words[1:] if side else words), "")
    return side + landmark if landmark else ""


def mirrored_name(name: str) -> str:
    """Return the name of the same landmark on the other side of the body; its own name if it is in the middle."""
    return {"L": "R", "R": "L"}[name[0]] + name[1:] if is_sided(name) else name


def is_sided(name: str) -> bool:
    """Whether a landmark is on one side of the body."""
    return len(name) > 1 and name[0] in "LR" and name[1].isupper()
