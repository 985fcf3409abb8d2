"""The body: parts on a tree, their kinematics, and the default human."""

from .body import Body, Part
from .human import default_measures, human
from .kinematics import landmark_positions, part_poses, point_jacobian, twist_jacobian

__all__ = [
    "Body",
    "Part",
    "default_measures",
    "human",
    "landmark_positions",
    "part_poses",
    "point_jacobian",
    "twist_jacobian",
]
