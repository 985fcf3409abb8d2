"""Every finding about a view has words for the user and figures for the report."""

from __future__ import annotations

import json
from typing import get_args

import pytest
from kfmocap.core.evidence.background_shift import BackgroundShift
from kfmocap.core.fitting.checks.picture_findings import DissolvingPictures, FadingPictures, FlickeringLight, Strangers
from kfmocap.core.fitting.checks.view_findings import CameraFit, FootageMatch, MovedCamera, PlainBackground, ViewFinding

FINDINGS = {
    CameraFit(9.26, 1.0, 3.0, "cam01", "key poses"): {"shift": 9.3, "deviation": 1.0, "limit": 3.0},
    FootageMatch("cam01", 0.512): {"match": 0.51},
    FootageMatch("cam01", 0.9, offset=2.5): {"match": 0.9, "offset": 2.5},
    FootageMatch("cam01", 0.9, shows="cam02"): {"match": 0.9, "shows": "cam02"},
    FootageMatch("cam01", 0.9, mirrored=0.9996): {"match": 0.9, "mirrored": 1.0},
    MovedCamera("cam01", BackgroundShift(12.34, (0, 20), 1.0004)): {
        "shift": 12.3,
        "frames": [0, 20],
        "enlarged": 1.0,
        "followed": False,
    },
    PlainBackground("cam01"): {},
    FadingPictures("cam01"): {},
    DissolvingPictures("cam01"): {},
    Strangers("cam01", 24): {"frame": 24},
    FlickeringLight("cam01", 0.15432): {"flicker": 0.154},
}


def test_every_kind_is_here() -> None:
    assert {type(found) for found in FINDINGS} == set(get_args(ViewFinding))


@pytest.mark.parametrize("found", FINDINGS, ids=lambda found: type(found).__name__)
def test_what_is_found_is_said_in_words_and_in_figures(found: ViewFinding) -> None:
    assert found.off and found.brief
    assert found.summary.startswith("cam01: ")
    assert json.loads(json.dumps(found.figures)) == FINDINGS[found]
