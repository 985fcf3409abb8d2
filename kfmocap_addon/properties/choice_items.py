"""The items of Blender's menus, from the choices of the core."""

from __future__ import annotations

from ...core.choices import Choices


def choice_items(choices: Choices) -> list[tuple[str, str, str]]:
    """Return the items of an enumeration: name, label and description of every choice."""
    return [(name, label, description) for name, (label, description) in choices.items()]
