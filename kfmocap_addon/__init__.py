"""The Blender side: scenes become core values, results become Blender data."""


def register() -> None:
    pass


def unregister() -> None:
    pass
