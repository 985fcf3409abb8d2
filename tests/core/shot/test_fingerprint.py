"""What checksums of values depend on: files keep them, and later versions compare them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from keypoint_shots import cameras
from kfmocap.core.errors import FootageError
from kfmocap.core.shot.fingerprint import checksum, made_of, value_bytes
from kfmocap.core.shot.shot import View


def sum_of(value: object) -> str:
    return checksum(value_bytes(value))


def test_a_field_that_is_added_changes_no_checksum_while_it_has_its_default():
    @dataclass(frozen=True)
    class Then:
        gain: float
        sweeps: int = 500

    @dataclass(frozen=True)
    class Now:
        gain: float
        sweeps: int = 500
        seed: int | None = None
        names: tuple[str, ...] = ()

    assert sum_of((Then(2.0), Then(2.0, 3))) == sum_of((Now(2.0), Now(2.0, 3)))
    assert len({sum_of(now) for now in (Now(2.0), Now(2.0, seed=1), Now(2.0, names=("a",)), Now(1.0))}) == 4


def test_footage_that_is_gone_is_named(tmp_path):
    """A drive may be disconnected while its footage is tracked."""
    view = View(cameras(1)[0], tmp_path / "cam01.mp4")
    with pytest.raises(FootageError, match=r"cam01\.mp4: it cannot be read any more"):
        made_of(view, 1.0)


def test_values_differ_if_any_of_their_fields_does():
    @dataclass(frozen=True)
    class Pair:
        one: float | bool | None = None
        other: float | bool | None = None
        grid: np.ndarray | tuple[()] = ()
        noted: str = field(default="", compare=False)

    values = [Pair(), Pair(1.0), Pair(None, 1.0), Pair(1), Pair(True), Pair(0.0), Pair(grid=np.zeros(2))]
    values += [(Pair(1.0), Pair(None, 1.0)), (Pair(1.0, 1.0), Pair()), (Pair(), Pair(1.0, 1.0))]
    assert len({sum_of(value) for value in values}) == len(values)
    assert sum_of(Pair(noted="here")) == sum_of(Pair())
