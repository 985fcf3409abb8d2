"""KF Mocap: keyframe motion tracking, as a Blender extension and a plain Python package.

Importing it pulls in neither Blender nor the core: each is loaded when asked for.
"""


def register() -> None:
    """Register the add-on in Blender."""
    from .kfmocap_addon import register as register_addon

    register_addon()


def unregister() -> None:
    """Take the add-on out of Blender again."""
    from .kfmocap_addon import unregister as unregister_addon

    unregister_addon()
