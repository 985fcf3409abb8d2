"""The Blender side: scenes become core values, results become Blender data.

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
