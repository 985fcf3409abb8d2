"""What sending a motion has changed of a rig, stored as JSON in the file of the scene, so that it can be undone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import bpy

from .held_bones import restore_drivers, restore_holds
from .rig_settings import Owner, restore_settings

Rows = list[list[Any]]


def rows_of_holds(holds: Mapping[tuple[str, str], float]) -> Rows:
    """Return influences of constraints, by bone and constraint, as lists of bone, constraint and influence."""
    return [[*key, float(value)] for key, value in holds.items()]


def rows_of_settings(settings: Mapping[tuple[Owner, str], Any]) -> Rows:
    """Return values of custom properties, by owner and property, as lists of owner, property and value."""
    return [[*key, value] for key, value in settings.items()]


def owner_of_row(stored: str | Sequence[str]) -> Owner:
    """Return the owner in a row of settings: JSON makes lists of pairs."""
    return stored if isinstance(stored, str) else (stored[0], stored[1])


def restore_rows(armature: bpy.types.Object, holds: Rows, settings: Rows, muted: Rows) -> None:
    """Give constraints and custom properties the values in rows, and let drivers (bone, attribute) drive again."""
    restore_holds(armature, {(bone, name): value for bone, name, value in holds})
    restore_settings(armature, {(owner_of_row(owner), key): value for owner, key, value in settings})
    restore_drivers(armature, [(bone, attribute) for bone, attribute in muted])
