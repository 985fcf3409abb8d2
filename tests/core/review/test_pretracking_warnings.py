"""What is to be asked about a shot before it is tracked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from kfmocap.core.body import human
from kfmocap.core.review.pretracking_warnings import unposed_text
from kfmocap.core.shot.shot import KeyPoses, Performer
from synthetic import at_rest

BODY = human(1.7)


def performer(without: tuple[str, ...], unknown: tuple[str, ...] = ()) -> Performer:
    """Somebody with two key poses of all parts but some."""
    keys = KeyPoses.whole([0, 9], at_rest(BODY, 2))
    fixed = keys.fixed.copy()
    for name in without:
        first = 3 + 3 * BODY.index(name)
        fixed[:, first : first + 3] = False
    return Performer("person", BODY, replace(keys, fixed=fixed), unknown=unknown)


def test_bones_that_were_never_keyed_are_named() -> None:
    said = unposed_text(performer(("hand.L", "foot.R")))
    assert "hand.L" in said
    assert "foot.R" in said


def test_nothing_is_said_of_whole_key_poses_and_of_unknown_parts() -> None:
    assert not unposed_text(performer(()))
    assert not unposed_text(performer(("foot.L", "foot.R"), unknown=("foot.L", "foot.R")))


def test_nothing_is_said_of_key_poses_of_a_few_bones() -> None:
    assert not unposed_text(performer(BODY.names[: len(BODY) - 3]))


def test_a_bone_that_was_keyed_once_is_not_forgotten() -> None:
    person = performer(("hand.L",))
    fixed = person.key_poses.fixed.copy()
    fixed[1] = True
    once = replace(person, key_poses=replace(person.key_poses, fixed=fixed))
    assert not unposed_text(once)
    assert np.array_equal(once.key_poses.full(), [9])
