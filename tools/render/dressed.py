"""A character as VRoid makes them: hair, skirt and breasts have bones of their own that a simulation swings.

It needs the bpy module.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np
from kfmocap.core.body import human
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from .figure import Figure, make_figure
from .rig_parts import any_direction, bind, coloured_mesh, key_turn, new_armature

Array = NDArray[np.float64]
Bone = tuple[str, str, Array, Array]
LOOSE = "_Sec_"
"""Part of the names of bones that a simulation swings."""
LOCKS, LOCK_LENGTHS = 11, (0.1, 0.12, 0.12)
PANELS, PANEL_LENGTHS, FLARE = 12, (0.14, 0.16), 0.45
"""Of the hair and of the skirt: number of chains, lengths of the bones of each, metres, and the skirt's spread."""
SWAY, LAG = 0.12, 0.5
"""Amplitude of the turns of loose bones, and the phase by which each is behind the one above, radians."""
HAIR, CLOTH, SHIRT = (0.32, 0.2, 0.12), (0.16, 0.2, 0.4), (0.75, 0.72, 0.7)
_WORDS: Mapping[str, str] = {
    "pelvis": "Hips", "spine": "Spine", "chest": "Chest", "head": "Head", "shoulder": "Shoulder",
    "upper_arm": "UpperArm", "forearm": "LowerArm", "hand": "Hand",
    "thigh": "UpperLeg", "shin": "LowerLeg", "foot": "Foot",
}  # fmt: skip


def vroid_names(parts: Sequence[str]) -> dict[str, str]:
    """Return VRoid's names of the bones of a body."""
    found = {}
    for part in parts:
        word, _, side = part.partition(".")
        found[part] = f"J_Bip_{side or 'C'}_{_WORDS[word]}"
    return found


def body_bones(figure: Figure, names: Mapping[str, str], above: str) -> list[Bone]:
    """Return the bones of a figure in its stance; the first hangs on the bone `above`."""
    body, found = figure.body, []
    for i, part in enumerate(body.parts):
        tail = figure.T_stance[i] + figure.R_stance[i] @ part.R_world_rest.T @ (part.tail_world - part.head_world)
        carrier = names[body.names[part.parent]] if part.parent >= 0 else above
        found.append((names[part.name], carrier, figure.T_stance[i], tail))
    return found


def vroid() -> bpy.types.Object:
    """A woman of 1.58 m with VRoid's bones: 33 of the hair, 24 of the skirt, two breasts."""
    figure = make_figure(human(1.58, collar_bones=True), 0.012)
    names = vroid_names(figure.body.names)
    bones = body_bones(figure, names, "Root")
    at = {name: (head, tail) for name, _, head, tail in bones}
    hair, skirt = _hair(*at[names["head"]]), _skirt(at[names["pelvis"]][0])
    busts = [
        (f"J_Sec_{side}_Bust1", names["chest"], middle, middle + [0.0, -0.06, 0.0])
        for side, x in (("L", 0.075), ("R", -0.075))
        for middle in [at[names["chest"]][0] * [0, 1, 1] + [x, -0.07, 0.12]]
    ]
    root = [("Root", "", np.zeros(3), np.array([0.0, 0.1, 0.0]))]
    armature = new_armature("Armature", np.eye(4), [*root, *bones, *hair, *skirt, *busts])
    skin = coloured_mesh("Body", figure.vertices, figure.triangles, figure.colours)
    bind(skin, armature, {names[part]: figure.weights[:, i] for i, part in enumerate(figure.body.names)})
    for name, chains, width, colour in (("Hair", hair, 0.05, HAIR), ("Skirt", skirt, 0.09, CLOTH)):
        _add_panels(armature, name, chains, width, colour)
    _add_panels(armature, "Top", [(*bust[:2], bust[2] + [0, 0.03, 0], bust[3]) for bust in busts], 0.08, SHIRT)
    return armature


def _hair(head: Array, top: Array) -> list[Bone]:
    """Locks from the crown of the head down its sides and back."""
    found: list[Bone] = []
    for k, angle in enumerate(np.linspace(-0.15, np.pi + 0.15, LOCKS)):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        place = head + 0.6 * (top - head) + 0.1 * out
        found += _chain(f"J_Sec_Hair{{}}_{k + 1:02d}", "J_Bip_C_Head", place, 0.15 * out - [0, 0, 1], LOCK_LENGTHS)
    return found


def _skirt(hips: Array) -> list[Bone]:
    found: list[Bone] = []
    for k, angle in enumerate(np.linspace(0, 2 * np.pi, PANELS, endpoint=False)):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        side = "L" if out[0] >= 0 else "R"
        place = hips + [0, 0, 0.03] + [0.17, 0.13, 0] * out
        name = f"J_Sec_{side}_Skirt{{}}_{k + 1:02d}"
        found += _chain(name, "J_Bip_C_Hips", place, FLARE * out - [0, 0, 1], PANEL_LENGTHS)
    return found


def _chain(name: str, above: str, place: Array, way: Array, lengths: Sequence[float]) -> list[Bone]:
    """Bones one below the other from a place along a way; `{}` in their name is their number from 1."""
    found = []
    for k, length in enumerate(lengths):
        end = place + length * way / np.linalg.norm(way)
        found.append((name.format(k + 1), above, place, end))
        above, place = name.format(k + 1), end
    return found


def _add_panels(
    armature: bpy.types.Object, name: str, bones: Sequence[Bone], width: float, colour: Sequence[float]
) -> None:
    """Add a mesh of a flattened tube around each bone, striped, and bound to it."""
    rng = np.random.default_rng(len(bones))
    turn, share = np.meshgrid(np.linspace(0, 2 * np.pi, 10, endpoint=False), np.linspace(0, 1, 6))
    number = np.arange(turn.size).reshape(turn.shape)
    a, b, c, d = number[:-1], np.roll(number[:-1], -1, 1), np.roll(number[1:], -1, 1), number[1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices, triangles, colours, weights = [], [], [], {}
    for k, (bone, _, head, tail) in enumerate(bones):
        along = (tail - head) / np.linalg.norm(tail - head)
        out = np.array([0, -1, 0]) if abs(along[1]) < 0.5 else np.array([0, 0, 1.0])
        side = np.cross(along, out) / np.linalg.norm(np.cross(along, out))
        round_it = width / 2 * (np.cos(turn)[..., None] * side + 0.6 * np.sin(turn)[..., None] * np.cross(side, along))
        vertices.append((head + share[..., None] * (tail - head) + round_it).reshape(-1, 3))
        triangles.append(faces + k * turn.size)
        tone = rng.uniform(0.8, 1.25) * (1 + 0.25 * np.sin(9 * share + 3 * turn)).reshape(-1, 1)
        colours.append(np.clip(tone * np.array(colour), 0.03, 0.95))
        weights[bone] = np.repeat(np.arange(len(bones)) == k, turn.size).astype(float)
    bind(coloured_mesh(name, *map(np.concatenate, (vertices, triangles, colours))), armature, weights)


def sway(armature: bpy.types.Object, frames: Sequence[int], fps: float, seed: int) -> None:
    """Key turns of the loose bones of a character on every frame, as a simulation would have them."""
    rng = np.random.default_rng(seed)
    for bone in armature.pose.bones:
        if LOOSE not in bone.name:
            continue
        axis, phase = any_direction(rng), LAG * len(bone.parent_recursive)
        for frame in frames:
            angle = SWAY * np.sin(2 * np.pi * 1.1 * frame / fps - phase)
            key_turn(bone, Matrix.Rotation(angle, 4, Vector(axis.tolist())), frame)
