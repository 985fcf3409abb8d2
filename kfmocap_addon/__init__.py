"""The Blender side: scenes become core values, results become Blender data.

Importing it pulls in no bpy; `register` does.
"""


def register() -> None:
    from . import registration

    registration.register()


def unregister() -> None:
    from . import registration

    registration.unregister()
