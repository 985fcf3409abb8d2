"""Keeps the add-on's words as they are written, in any language of Blender's interface.

Blender would translate those that it knows, and some of them wrongly, as *Feet* by the unit of length: half of the tab
would be in one language, half in the other, and nothing would have the names that the documents give.
"""

from __future__ import annotations

import typing
from collections.abc import Sequence
from typing import Any

import bpy

CONTEXT = "KF Mocap"
"""The context of translations, in which Blender knows none."""
_KEPT = "kfmocap_words_kept"
"""Attribute of classes whose words are kept."""


def keep_words(classes: Sequence[Any]) -> None:
    """Have Blender translate neither labels of classes that are about to be registered nor those of their properties.

    Attributes inherited from Blender's own classes are set on the class itself: other add-ons inherit them, too.
    """
    for cls in classes:
        if vars(cls).get(_KEPT):  # the add-on was disabled and is enabled again
            continue
        setattr(cls, _KEPT, True)
        if not issubclass(cls, bpy.types.PropertyGroup):
            cls.bl_translation_context = CONTEXT
        hints = typing.get_type_hints(cls).items()
        cls.__annotations__ = {name: _in_context(hint) for name, hint in hints}


def _in_context(hint: Any) -> Any:
    """Return a property that is yet to be registered, in the context; any other annotation as it is."""
    if not hasattr(hint, "keywords"):
        return hint
    return hint.function(**{**hint.keywords, "translation_context": CONTEXT})
