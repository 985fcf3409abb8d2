"""Which of the people in the keypoints a performer of a scene is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from ...core.keypoints.association.assignment import Identity


def write_identity(slot: bpy.types.PropertyGroup, identity: Identity) -> None:
    """Remember who a performer was found to be."""
    slot.identity, slot.found_person = str(identity), identity.person or 0


def exchange_people(scene: bpy.types.Scene, one: bpy.types.PropertyGroup, other: bpy.types.PropertyGroup) -> None:
    """Make each of two performers the person that the other one is.

    Who was not found yet counts by its place among the performers.
    """
    slots = list(scene.kfmocap.performers)
    numbers = [slot.person or slot.found_person or slots.index(slot) + 1 for slot in (one, other)]
    for slot, number in zip((one, other), reversed(numbers), strict=True):
        slot.person, slot.identity = number, f"person {number}, not posed anew yet"
