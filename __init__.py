"""KF Mocap: keyframe motion tracking, as a Blender extension and a plain Python package.

Importing it pulls in neither Blender nor the core: each is loaded when asked for.
"""


def register() -> None:
    from . import kfmocap_addon

    kfmocap_addon.register()


def unregister() -> None:
    from . import kfmocap_addon

    kfmocap_addon.unregister()
