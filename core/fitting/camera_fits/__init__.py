"""Cameras fitted to outlines of the performers, or to shared keypoints."""
