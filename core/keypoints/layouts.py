"""The orders in which detectors list their keypoints, with our names of them.

Names are those of the body's landmarks (Pose2Sim's), and a few more of the face; an empty name is a keypoint that is
not used. Where several orders have the same number of keypoints, the one that the detectors' own programs write counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

COCO_17 = (
    "Nose LEye REye LEar REar LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee LAnkle RAnkle"
).split()
MPII_16 = (
    "RAnkle RKnee RHip LHip LKnee LAnkle Hip - Neck Head RWrist RElbow RShoulder LShoulder LElbow LWrist"
).split()
OPENPOSE_18 = (
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle LHip LKnee LAnkle REye LEye REar LEar"
).split()
BODY_25 = (
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist Hip RHip RKnee RAnkle LHip LKnee LAnkle "
    "REye LEye REar LEar LBigToe - LHeel RBigToe - RHeel"
).split()
HALPE_26 = [*COCO_17, *"Head Neck Hip LBigToe RBigToe - - LHeel RHeel".split()]
MEDIAPIPE_33 = (
    "Nose - LEye - - REye - LEar REar - - LShoulder RShoulder LElbow RElbow LWrist RWrist - - - - - - "
    "LHip RHip LKnee RKnee LAnkle RAnkle LHeel RHeel LBigToe RBigToe"
).split()


def _hands(first: int, count: int) -> list[str]:
    """The rest of a list whose last 42 are the hands', 21 each; of a hand the tip of its middle finger is used."""
    rest = ["-"] * (count - first)
    rest[-42 + 12], rest[-21 + 12] = "LHand", "RHand"
    return rest


COCO_133 = [*COCO_17, *"LBigToe - LHeel RBigToe - RHeel".split(), *_hands(23, 133)]
HALPE_136 = [*HALPE_26, *_hands(26, 136)]

_LAYOUTS = (MPII_16, COCO_17, OPENPOSE_18, BODY_25, HALPE_26, MEDIAPIPE_33, COCO_133, HALPE_136)
LAYOUTS: Mapping[int, Sequence[str]] = {
    len(names): tuple("" if name == "-" else name for name in names) for names in _LAYOUTS
}
"""Our names of a detector's keypoints, by how many it lists."""

_SPOKEN = {
    "left": "L",
    "right": "R",
    "nose": "Nose",
    "eye": "Eye",
    "ear": "Ear",
    "shoulder": "Shoulder",
    "elbow": "Elbow",
    "wrist": "Wrist",
    "hip": "Hip",
    "knee": "Knee",
    "ankle": "Ankle",
    "heel": "Heel",
    "neck": "Neck",
    "head": "Head",
    "big toe": "BigToe",
    "foot index": "BigToe",
    "pelvis": "Hip",
    "mid hip": "Hip",
    "root": "Hip",
}


def landmark_of(spoken: str) -> str:
    """Our name of a keypoint that a file names itself, as `left_shoulder`; empty if it is not used."""
    words = spoken.lower().replace("_", " ").split()
    side = _SPOKEN[words.pop(0)] if words and words[0] in ("left", "right") else ""
    name = _SPOKEN.get(" ".join(words), "")
    return side + name if name else ""


def mirrored(name: str) -> str:
    """The name of the same landmark on the body's other side; its own on the middle."""
    return {"L": "R", "R": "L"}[name[0]] + name[1:] if is_sided(name) else name


def is_sided(name: str) -> bool:
    return len(name) > 1 and name[0] in "LR" and name[1].isupper()
