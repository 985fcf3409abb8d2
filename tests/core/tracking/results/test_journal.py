"""A run that was ended and taken up again gives what it would have given in one go."""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.errors import CancelledError
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.results.journal import JOURNAL_SUFFIX, Journal, KeptSegments, journal_beside, run_key
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.scheduling.run_context import RunContext
from kfmocap.core.tracking.tracker import track
from synthetic import CAMERAS, figure, film, shot_of, swing

BODY = figure()
LENGTH = 13
TRUTH = swing(BODY, LENGTH)
KEYS = (0, 4, 8, 12)


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    views = film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS)
    return shot_of(views, [BODY], [TRUTH], KEYS, Settings(limb_search=False))


@pytest.fixture(scope="module")
def whole(shot: Shot) -> TrackResult:
    return track(shot, pictures=(3, 9))


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory, shot: Shot) -> Path:
    """The journal of a run that was ended when it had finished two of three segments."""
    journal = Journal(tmp_path_factory.mktemp("ended") / "journal")
    with pytest.raises(CancelledError):
        track(shot, lambda *_: len(journal.kept) < 2, run=RunContext(journal))
    return journal.folder


def numbers(result: TrackResult) -> list[np.ndarray]:
    motions = [x for m in result.motions for x in (m.translations, m.rotations)]
    rest = (*result.visible, *result.residual, *result.deviation, np.array(result.footage_offset))
    energies = [np.array([s.first, s.last, s.iterations, *s.energy]) for s in result.segments]
    found = [x for s in result.segments for x in s.accelerations]
    pictures = [image for view in result.pictures for _, image in sorted(view.items())]
    return [*motions, *rest, *energies, *found, *pictures]


def assert_identical(a: TrackResult, b: TrackResult) -> None:
    for x, y in zip(numbers(a), numbers(b), strict=True):
        np.testing.assert_array_equal(x, y)
    assert a.torn == b.torn
    assert a.late == b.late
    assert a.unknown == b.unknown


def copied(folder: Path, to: Path) -> Path:
    to.mkdir()
    for file in folder.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def test_a_run_that_was_taken_up_gives_the_same_to_the_last_bit(
    tmp_path: Path, shot: Shot, whole: TrackResult, ended: Path
) -> None:
    journal = Journal(copied(ended, tmp_path / "journal"), resume=True)
    result = track(shot, pictures=(3, 9), run=RunContext(journal))
    assert journal.taken == [(0, 4), (4, 8)]
    assert journal.kept == [(8, 12)]
    assert_identical(result, whole)


def test_finished_segments_are_not_solved_again(tmp_path: Path, shot: Shot, ended: Path) -> None:
    solved: set[tuple[int, int]] = set()
    journal = Journal(copied(ended, tmp_path / "journal"), resume=True)
    track(shot, observe=lambda segment, *_: solved.add(segment), run=RunContext(journal))
    assert solved == {(8, 12)}


def known(folder: Path, shot: Shot) -> list[tuple[int, int]]:
    """The segments that would be taken from a journal."""
    return list(KeptSegments.of(Journal(folder, resume=True), shot, (None, None)).known)


def test_plants_that_were_held_are_kept(tmp_path: Path, shot: Shot, ended: Path) -> None:
    key, segment = run_key(shot.with_settings_filled(), (None, None)), (0, 4)
    finished = Journal(ended, resume=True).read(key, segment)
    assert finished is not None and finished.planted == (None,)
    planted = np.arange(20).reshape(5, 4) % 3 == 0
    Journal(tmp_path / "journal").write(key, replace(finished, planted=(planted,)))
    again = Journal(tmp_path / "journal", resume=True).read(key, segment)
    assert again is not None
    np.testing.assert_array_equal(again.planted[0], planted)


def damages(data: bytes, other: bytes) -> dict[str, bytes]:
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    return {"cut": data[:-9], "flipped": bytes(flipped), "empty": b"", "of another segment": other, "none": b"cos\n."}


def test_damaged_segments_are_tracked_again(tmp_path: Path, shot: Shot, whole: TrackResult, ended: Path) -> None:
    folder = copied(ended, tmp_path / "journal")
    filled = shot.with_settings_filled()
    assert known(folder, filled) == [(0, 4), (4, 8)]
    first, second = sorted(folder.iterdir())
    for damaged in damages(first.read_bytes(), second.read_bytes()).values():
        first.write_bytes(damaged)
        assert known(folder, filled) == [(4, 8)]
    assert_identical(track(shot, pictures=(3, 9), run=RunContext(Journal(folder, resume=True))), whole)


def test_segments_of_another_shot_are_not_taken(tmp_path: Path, shot: Shot, ended: Path) -> None:
    filled = shot.with_settings_filled()
    view = shot.views[0]
    images = shutil.copytree(view.footage.parent, tmp_path / "film")
    there = replace(filled, views=(replace(view, footage=images / view.footage.name), shot.views[1]))
    assert known(ended, there)  # where the files are does not count
    image = images / "005.png"
    image.write_bytes(image.read_bytes() + b"0")
    assert not known(ended, there)
    assert not known(ended, replace(filled, fps=29.0))
    assert not known(ended, replace(filled, settings=replace(filled.settings, working_size=300)))
    assert not known(ended, shot_of(shot.views, [BODY], [TRUTH[[*range(12), 11]]], KEYS).with_settings_filled())


@pytest.mark.parametrize("error", [KeyboardInterrupt, CancelledError, OSError, None])
@pytest.mark.parametrize("resume", [False, True])
def test_segments_stay_of_a_run_that_failed_or_was_interrupted_with_resume(
    tmp_path: Path, ended: Path, error: type[BaseException] | None, resume: bool
) -> None:
    """All of it where it failed; what was interrupted stays where it was asked for; nothing of what ended well."""
    folder = copied(ended, tmp_path / f"out{JOURNAL_SUFFIX}")
    with suppress(BaseException), journal_beside(tmp_path / "out", resume=resume) as journal:
        assert folder.exists() == resume
        if not resume:
            copied(ended, folder)
        assert journal.folder == folder
        if error is not None:
            raise error
    assert folder.exists() == (error is OSError or (resume and error is not None))


def test_a_run_that_failed_says_what_is_kept_and_leaves_no_empty_folder(
    tmp_path: Path, shot: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OSError, match="disk") as caught, journal_beside(tmp_path / "out", resume=False) as journal:
        track(shot, run=RunContext(journal))
        raise OSError("the disk is full")
    assert caught.value.__notes__ == [f"{len(journal.kept)} finished segments are kept; --resume goes on from there"]
    del journal.kept[1:]
    assert journal.what_stays.startswith("1 finished segment is kept;")

    def full(file: Path, data: bytes) -> None:
        file.touch()
        raise OSError("the disk is full")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="disk") as caught, journal_beside(tmp_path / "none", resume=False) as journal:
        track(shot, run=RunContext(journal))
        raise OSError("the disk is full")
    assert not journal.kept and not journal.folder.exists()
    assert not hasattr(caught.value, "__notes__")


def test_a_journal_that_cannot_be_written_keeps_nobody_from_the_results(
    tmp_path: Path, shot: Shot, whole: TrackResult
) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for folder in (tmp_path / "link", tmp_path / "no" / "such"):
        journal = Journal(folder)
        assert_identical(track(shot, pictures=(3, 9), run=RunContext(journal)), whole)
        assert not journal.kept
    assert not list((tmp_path / "elsewhere").iterdir())
