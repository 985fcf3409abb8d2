"""What a scene knows of its shot beyond Blender's own data."""

from . import export_properties, performer_properties, retarget_properties, shot_properties, view_properties

CLASSES = (
    *view_properties.CLASSES,
    *performer_properties.CLASSES,
    *export_properties.CLASSES,
    *retarget_properties.CLASSES,
    *shot_properties.CLASSES,
)
"""In the order in which they are registered: what others point to comes first."""
