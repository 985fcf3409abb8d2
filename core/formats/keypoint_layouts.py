"""The orders in which detectors list their keypoints, with our names of them.

Names are those of the body's landmarks (Pose2Sim's), and a few more of the face; an empty name is a keypoint that is
not used. Where several orders have the same number of keypoints, the one that the detectors' own programs write counts;
of OpenPose's two orders of 25 the right one is chosen by the people themselves.
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
    """The rest of a list whose last 42 are the hands', 21 each; of a hand the tip of its middle finger is used."""
    rest = ["-"] * (count - first)
    rest[-42 + 12], rest[-21 + 12] = "LHand", "RHand"
    return rest


HAND_POINTS = (
    "Wrist",
    *(f"{finger}{k}" for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky") for k in range(1, 5)),
)
"""The points of a hand in the order of all detectors that are known: the wrist, then each finger from its knuckle (the
thumb: from its root) to its tip."""
HAND_NAMES = tuple(f"{side}Hand{point}" for side in "LR" for point in HAND_POINTS)
"""Of both hands."""
WHOLE_BODY = (133, 136)
"""Lists of so many keypoints end with those of both hands, the left one first."""

COCO_133 = [*COCO_17, *_listed("LBigToe - LHeel RBigToe - RHeel"), *_hands(23, 133)]
HALPE_136 = [*HALPE_26, *_hands(26, 136)]


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple("" if name == "-" else name for name in names)


_LAYOUTS = (MPII_16, COCO_17, OPENPOSE_18, BODY_25, HALPE_26, MEDIAPIPE_33, COCO_133, HALPE_136)
LAYOUTS: Mapping[int, Sequence[str]] = {len(names): _named(names) for names in _LAYOUTS}
"""Our names of a detector's keypoints, by how many it lists."""


def keypoint_layout(people: NDArray[np.float64]) -> Sequence[str]:
    """Our names of the keypoints of people whose lists have one length.

    OpenPose has two orders of 25. BODY_25 lists the eyes and ears 16th to 19th and a whole arm among the first five;
    BODY_25B begins with the face and has the ankles, the neck and the head's top there.

    Parameters
    ----------
    people : (n, k, 3) array
        x, y, confidence of every keypoint; confidence 0 where it was not found.
    """
    count = people.shape[1]
    if count != len(BODY_25B):
        return LAYOUTS[count]
    votes = 2 * _extents(people[:, :5]) - _extents(people[:, 15:19])
    return _named(BODY_25B) if (votes < 0).sum() > (votes > 0).sum() else LAYOUTS[count]


def _extents(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Diagonals of the boxes round people's (n, k, 3) keypoints; NaN with fewer than three found."""
    found = points[..., 2:] > 0
    lowest = np.where(found, points[..., :2], np.inf).min(axis=1)
    highest = np.where(found, points[..., :2], -np.inf).max(axis=1)
    return np.where(found.sum(axis=(1, 2)) >= 3, np.linalg.norm(highest - lowest, axis=1), np.nan)


_SPOKEN = {
    **{name.lower(): name for name in _listed("Nose Eye Ear Shoulder Elbow Wrist Hip Knee Ankle Heel Neck Head")},
    "big toe": "BigToe",
    "foot index": "BigToe",
    "pelvis": "Hip",
    "mid hip": "Hip",
    "root": "Hip",
}


def landmark_of(spoken: str) -> str:
    """Our name of a keypoint that a file names itself, as `left_shoulder`; empty if it is not used."""
    words = spoken.lower().replace("_", " ").split()
    side = {"left": "L", "right": "R"}.get(words[0], "") if words else ""
    name = _SPOKEN.get(" ".join(words[1:] if side else words), "")
    return side + name if name else ""


def mirrored_name(name: str) -> str:
    """The name of the same landmark on the body's other side; its own on the middle."""
    return {"L": "R", "R": "L"}[name[0]] + name[1:] if is_sided(name) else name


def is_sided(name: str) -> bool:
    """Whether a landmark is on one side of the body."""
    return len(name) > 1 and name[0] in "LR" and name[1].isupper()
