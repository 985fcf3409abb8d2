"""The Blender side: turns scenes into core values, and results into Blender data.

Importing it pulls in no bpy; `register` does.
"""


def register() -> None:
    """Add the classes, properties and handlers of the add-on, and its command, to Blender."""
    from . import batch, registration

    registration.register()
    batch.register()


def unregister() -> None:
    """Remove them again."""
    from . import registration

    registration.unregister()
