"""What the panels of the sidebar tab have in common."""

from ..viewports.screens import SIDEBAR_TAB


class Section:
    """Where our panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = SIDEBAR_TAB
