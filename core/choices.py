"""What users choose from by name, with the words for it: the same in shot files, on the command line and in Blender.

Blender loads this when it starts, so it imports only Python's standard library.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

Choices = Mapping[str, tuple[str, str]]
"""Label and description of everything to choose from, by its name; the first is the default."""

SOLVERS: Choices = MappingProxyType(
    {
        "gauss-newton": ("Gauss-Newton", "All frames between two key poses at once: the best results"),
        "relaxation": ("Relaxation", "Frame by frame in sweeps, as first published: for comparison"),
    }
)
BEST_SOLVER = "gauss-newton"
"""The default, and the only one that uses all evidence."""
ROOT_MOTIONS: Choices = MappingProxyType(
    {
        "world": ("On the Hips", "The character moves through the world"),
        "root-bone": ("On the Root Bone", "The way over the ground goes on the rig's root bone"),
        "in-place": ("In Place", "The character stays over its first place"),
    }
)
FEET: Choices = MappingProxyType(
    {
        "keep": ("Keep", "Planted feet move as the performer's do, whatever the length of the legs"),
        "clean": ("Clean", "Planted feet stand quite still, flat on the floor"),
        "off": ("Off", "Joint angles alone"),
    }
)
HAND_SHAPES: Choices = MappingProxyType(
    {
        "relaxed": ("Relaxed", "Slightly bent, as of a hand that does nothing"),
        "flat": ("Flat", "As in the rest pose"),
        "grip": ("Grip", "Around a handle"),
        "fist": ("Fist", "Closed"),
        "point": ("Point", "The index finger stretched, the others closed"),
    }
)
CALIBRATION_ENDINGS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "toml": (".toml",),
        "caliscope": (".toml",),
        "qualisys": (".qca.txt", ".qca"),
        "opencv": (".yml", ".yaml", ".json"),
    }
)
"""Endings of calibration files, in lower case, by the names of their formats. The first format with an ending reads
files with it, and writes them unless another format is asked for by name."""


def either(names: Iterable[str]) -> str:
    """Return names as a sentence lists them: "a, b or c"."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
