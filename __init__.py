"""KF Mocap: keyframe motion tracking, as a Blender extension and a plain Python package.

Importing it pulls in neither Blender nor the core: each is loaded when asked for.
"""


def register() -> None:
    from .kfmocap_addon import register as register_addon

    register_addon()


def unregister() -> None:
    from .kfmocap_addon import unregister as unregister_addon

    unregister_addon()
