"""Tell which Debian packages this machine lacks before bpy can be installed and loaded.

Needs nothing but the standard library, so it runs before anything is installed. With `--import-bpy`
it also loads bpy itself, which finds what the table below does not know.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import re
import sys

BPY_PYTHON = (3, 11)

# Everything outside libc that bpy's own libraries link to: `ldd bpy/__init__.so`, then `dpkg -S`.
DEBIAN_PACKAGES = {
    "libstdc++.so.6": "libstdc++6",
    "libgcc_s.so.1": "libgcc-s1",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
}


def can_load(soname: str) -> bool:
    """Whether the dynamic linker finds a shared library."""
    try:
        ctypes.CDLL(soname)
    except OSError:
        return False
    return True


def missing_packages() -> list[str]:
    """Debian packages to install, in the order of the table."""
    packages = []
    if not importlib.util.find_spec("ensurepip") and not importlib.util.find_spec("pip"):
        packages.append(f"python{sys.version_info.major}.{sys.version_info.minor}-venv")
    if sys.platform == "linux":
        packages += [package for soname, package in DEBIAN_PACKAGES.items() if not can_load(soname)]
    return packages


def bpy_error() -> str | None:
    """Return what keeps bpy from loading, or None."""
    try:
        import bpy  # noqa: F401  whether it loads is the question
    except ImportError as error:
        library = re.match(r"(\S+\.so\S*): cannot open shared object file", str(error))
        if library:
            return f"bpy needs {library[1]}; `apt-file search {library[1]}` names the Debian package with it."
        return f"bpy cannot be loaded: {error}"
    return None


def main() -> int:
    """Check this Python and this machine; 1 if something is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--import-bpy", action="store_true", help="also load bpy")
    arguments = parser.parse_args()

    if sys.version_info[:2] != BPY_PYTHON:
        wanted, found = (".".join(map(str, version)) for version in (BPY_PYTHON, sys.version_info[:3]))
        print(f"bpy 5.0.1 needs Python {wanted}, this is {found}: make install PYTHON=/path/to/python{wanted}")
        return 1
    if packages := missing_packages():
        print("Some Debian packages are missing on this machine. Install them, then run make again:\n")
        print(f"    apt-get install -y {' '.join(packages)}\n")
        return 1
    if arguments.import_bpy and (error := bpy_error()):
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
