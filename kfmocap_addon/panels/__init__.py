"""The sidebar tab "KF Mocap" of the 3D view: a section for each step of the work, in its order."""

from . import body, calibration, export, footage, key_poses, review, track

SECTIONS = (footage, calibration, body, key_poses, track, review, export)
"""Modules with a tuple `CLASSES` each."""
