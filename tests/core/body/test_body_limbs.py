"""Limbs are chains of a body's parts, and like ones on the left and the right are pairs."""

from __future__ import annotations

from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs, limbs
from synthetic import figure

BODY = human(1.75)


def test_limbs_go_from_where_the_tree_branches_last_to_its_tips() -> None:
    names = [[BODY.names[part] for part in chain] for chain in limbs(BODY)]
    assert sorted(names) == sorted(
        [
            [f"{part}.{side}" for part in parts]
            for side in "LR"
            for parts in (["upper_arm", "forearm", "hand"], ["thigh", "shin", "foot"])
        ]
    )
    assert all(len(chain) > 1 for chain in limbs(figure()))


def test_a_pair_is_the_left_and_the_right_of_the_same_parts() -> None:
    named = [tuple([BODY.names[part] for part in chain] for chain in pair) for pair in limb_pairs(BODY)]
    assert len(named) == 2
    for left, right in named:
        assert [name.replace(".L", ".R") for name in left] == right
    assert not limb_pairs(figure())
