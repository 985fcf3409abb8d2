"""The study of the relaxation tracks with each variant, and leaves the solver as it was."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from conftest import ROOT
from kfmocap.benchmarks.studies import relaxation_study
from kfmocap.benchmarks.studies.relaxation_study import VARIANTS
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.solvers.paper_relaxation import relaxation

WALK = ROOT / "examples" / "walk"


def constants() -> dict[str, object]:
    return {name: getattr(relaxation, name) for changes in VARIANTS.values() for name in changes}


def test_every_variant_is_tracked_as_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    used, before = [], constants()

    def tracked(shot: Shot) -> object:
        assert shot.settings.solver == "relaxation" and shot.settings.sweeps == 1
        used.append(constants())
        return SimpleNamespace(motions=[spline(shot.performers[0].key_poses, shot.length)])

    monkeypatch.setattr(relaxation_study, "track", tracked)
    arguments = [str(WALK / "shot.toml"), str(WALK / "landmarks.trc"), "--views", "cam02", "--sweeps", "1"]
    assert relaxation_study.main(arguments) == 0
    assert used == [before | changes for changes in VARIANTS.values()]
    assert constants() == before
    assert capsys.readouterr().out.count("\n| ") >= len(VARIANTS)
