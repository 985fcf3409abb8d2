"""Keeping values as they were before Blender rounded them to single precision.

A scene that was not changed is then exactly the shot from which it was built, and gives the same motion as the shot
file. Values that were changed in Blender are taken from Blender.
"""

from __future__ import annotations

import json

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ...core.numerics.arrays import Array, Bools
from ..session import SESSION

Owner = bpy.types.ID | bpy.types.Bone

_TEXTS = 1024  # values that are remembered
_ROUNDING = 1e-6  # single precision after a few operations, relative


def keep(owner: Owner, name: str, values: ArrayLike) -> None:
    """Store values as a custom property of the object that holds them rounded."""
    owner[name] = json.dumps(np.asarray(values, float).tolist())


def recall(owner: Owner, name: str, read: ArrayLike, scale: float = 1.0) -> Array:
    """Return the values that were stored, if those read from Blender are the same but for rounding; else those read.

    Parameters
    ----------
    read : array-like
        As they are in Blender now.
    scale : float
        Size of the numbers that went into the values, in their unit: it sets what rounding can have done.
    """
    read = np.asarray(read, float)
    kept = stored(owner[name]) if name in owner else None
    return kept if kept is not None and kept.shape == read.shape and same(kept, read, scale) else read


def stored(text: str) -> Array:
    """Return the values as they were stored, which must not be written to. They are remembered: a body is read often,
    and its parts are long texts.
    """
    return SESSION.remembering(_values, _TEXTS)(text)


def _values(text: str) -> Array:
    values = np.array(json.loads(text), float)
    values.setflags(write=False)
    return values


def same(a: Array, b: Array, scale: float = 1.0) -> bool:
    """Whether values differ by rounding alone."""
    return bool(alike(a, b, scale).all())


def alike(a: Array, b: Array, scale: float = 1.0) -> Bools:
    """Return which values differ by rounding alone; NumPy's `isclose` takes ten times as long."""
    return np.asarray(np.abs(a - b) <= _ROUNDING * (scale + np.abs(b)))
