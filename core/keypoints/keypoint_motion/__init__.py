"""Poses, and the motion of a whole shot, from keypoints alone."""
