"""Cameras from the 2D keypoints of a performer, without a wand."""
