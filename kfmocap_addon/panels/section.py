"""What the sections of the sidebar tab "KF Mocap" have in common."""


class Section:
    """Where our panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "KF Mocap"
