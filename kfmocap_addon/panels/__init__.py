"""The sidebar tab "KF Mocap" of the 3D view: a section for each step of the work, in its order."""

from . import (
    body_panel,
    calibration_panel,
    export_panel,
    footage_panel,
    key_poses_panel,
    retarget_panel,
    review_panel,
    section,
    track_panel,
)

PANEL_MODULES = (
    section,
    footage_panel,
    calibration_panel,
    body_panel,
    key_poses_panel,
    track_panel,
    review_panel,
    retarget_panel,
    export_panel,
)
"""Modules with a tuple `CLASSES` each."""
