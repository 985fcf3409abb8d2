"""The version of the program."""

from __future__ import annotations


def program_version() -> str:
    """Return the version of the installed program; inside Blender, where there is only the extension, "extension"."""
    from importlib import metadata  # takes as long to load as all else that `kfmocap --help` needs

    try:
        return metadata.version("kfmocap")
    except metadata.PackageNotFoundError:
        return "extension"
