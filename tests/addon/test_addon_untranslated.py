"""Blender's interface in another language: the add-on has the words of its documents, not some of them translated."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.kfmocap_addon import registration, untranslated  # noqa: E402
from random_calls import TOOLS, tool_of  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

BLENDERS_OWN = {"rna_type", "name"}


def test_no_label_is_looked_up_among_blenders_words(blender):
    shown = [cls for cls in registration.CLASSES if issubclass(cls, bpy.types.Operator | bpy.types.Panel)]
    assert {cls.bl_rna.translation_context for cls in shown} == {untranslated.CONTEXT}
    groups = [cls.bl_rna for cls in registration.CLASSES if issubclass(cls, bpy.types.PropertyGroup)]
    looked_up = [
        (kind.identifier, item.identifier)
        for kind in (*groups, *(tool_of(cls).get_rna_type() for cls in TOOLS))
        for item in kind.properties
        if item.identifier not in BLENDERS_OWN and item.translation_context != untranslated.CONTEXT
    ]
    assert not looked_up


def test_blenders_own_file_browsers_keep_their_words(blender):
    other = bpy.ops.import_anim.bvh.get_rna_type()
    assert other.properties["filepath"].translation_context != untranslated.CONTEXT
