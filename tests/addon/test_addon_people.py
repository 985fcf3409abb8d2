"""Which of the people in the keypoints a performer is, in Blender."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from kfmocap.core.keypoints.association.assignment import Identity  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import identities  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender


@pytest.fixture
def slots(blender, tmp_path):
    scenes.build_scene(shot(tmp_path, ("man", "woman", "child")), scene=bpy.context.scene)
    return bpy.context.scene.kfmocap.performers


def numbers() -> list[int | None]:
    return [performer.person for performer in scenes.shot_from_scene(bpy.context.scene).performers]


def test_performers_are_nobody_in_particular_until_a_number_is_given(slots):
    assert numbers() == [None, None, None]
    slots["woman"].person = 3
    assert numbers() == [None, 3, None]


def test_exchanging_gives_each_the_number_of_the_other(slots):
    for slot, person in zip(slots, (2, 3, 1), strict=True):
        identities.write_identity(slot, Identity(person, 3, "order of appearance"))
    assert slots["man"].identity == "person 2 of 3, by order of appearance"
    bpy.context.scene.kfmocap.performer = "man"
    assert bpy.ops.kfmocap.exchange_people(other="child") == {"FINISHED"}
    assert numbers() == [1, None, 2]
    assert "not posed anew" in slots["man"].identity
    assert bpy.ops.kfmocap.exchange_people(other="child") == {"FINISHED"}
    assert numbers() == [2, None, 1]


def test_unassigned_people_follow_the_order_of_the_performers(slots):
    bpy.context.scene.kfmocap.performer = "woman"
    assert bpy.ops.kfmocap.exchange_people() == {"FINISHED"}
    assert numbers() == [None, 3, 2]


def test_two_performers_are_enough_to_exchange_and_one_is_not(slots):
    for index in (2, 1):
        slots.remove(index)
        assert bpy.ops.kfmocap.exchange_people.poll() == (index == 2)


def test_nobody_is_exchanged_with_itself(slots):
    with pytest.raises(RuntimeError, match="'man' is no other performer"):
        bpy.context.scene.kfmocap.performer = "man"
        bpy.ops.kfmocap.exchange_people(other="man")
    assert numbers() == [None, None, None]
