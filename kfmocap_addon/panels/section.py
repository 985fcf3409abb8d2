"""What the panels of the sidebar tab have in common: sections with a title, which fold, and parts of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..operators.open_section import OpenSection
from ..scene_io import active_performer
from ..viewports import screens
from ..viewports.screens import SIDEBAR_TAB
from . import guide
from .texts import draw_replaced_rate

# For mypy it is a panel; Blender shall not meet panels that are never registered.
PanelMixin = bpy.types.Panel if TYPE_CHECKING else object


_PREFIX = "KFMOCAP_PT_"
"""Prefix of the `bl_idname` of a section's panel; the section's name in `properties.section_properties` follows."""


class _OnTab(PanelMixin):
    """Where our panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = SIDEBAR_TAB


class SectionsPanel(_OnTab, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_sections"
    bl_label = SIDEBAR_TAB

    def draw(self, context: bpy.types.Context) -> None:
        """Open and fold sections as the work goes on; each section draws itself. What concerns all is above them."""
        guide.follow(context)
        screens.keep_clear(context)
        draw_replaced_rate(self.layout, context)


class Section(_OnTab):
    """A section: its title, with a tick where the step is done, and below it what it holds while it is open.

    Blender's own titles cannot be folded by a program, so it draws its own. Panels without one of Blender's would put
    the tab before Blender's own tabs: all sections are in a panel that has one.
    """

    bl_options = {"HIDE_HEADER"}
    bl_parent_id = SectionsPanel.bl_idname

    @classmethod
    def section_name(cls) -> str:
        """Return the section's name in `properties.section_properties.SECTIONS`."""
        return cls.bl_idname.removeprefix(_PREFIX)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the title, and what the section holds."""
        name = self.section_name()
        is_open = guide.is_open(context, name)
        row = self.layout.row()
        left = row.row()
        left.alignment = "LEFT"
        icon = "DOWNARROW_HLT" if is_open else "RIGHTARROW"
        left.operator(OpenSection.bl_idname, text=self.bl_label, icon=icon, emboss=False).section = name
        if guide.is_done(context, name):
            right = row.row()
            right.alignment = "RIGHT"
            right.label(text="", icon="CHECKMARK")
        if is_open:
            self.draw_content(context)

    def draw_content(self, context: bpy.types.Context) -> None:
        """Draw what the section holds."""
        raise NotImplementedError


def draw_as_form(layout: bpy.types.UILayout) -> None:
    """Let the fields that are drawn from here on have their names on the left, as in Blender's properties editor."""
    layout.use_property_split, layout.use_property_decorate = True, False


class SectionPart(_OnTab):
    """A part of a section with a title of its own, which is there while the section, its parent, is open."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether the section is open and the part has something to show."""
        return guide.is_open(context, cls.bl_parent_id.removeprefix(_PREFIX)) and cls.is_needed(context)

    @classmethod
    def is_needed(cls, _context: bpy.types.Context) -> bool:
        """Whether the part has something to show."""
        return True


class FoldedPart(SectionPart):
    """A part that is folded until somebody opens it."""

    bl_options = {"DEFAULT_CLOSED"}


class PerformerPart(SectionPart):
    """A part that is there while there is a performer to pose."""

    @classmethod
    def is_needed(cls, context: bpy.types.Context) -> bool:
        """Whether there is a performer to pose."""
        return active_performer.chosen(context) is not None


CLASSES = (SectionsPanel,)
