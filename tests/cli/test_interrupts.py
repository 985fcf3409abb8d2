"""Runs that are interrupted: what is written is whole, and the exit code says which signal it was."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from kfmocap.cli import track_command, tracked_files
from kfmocap.core.errors import CancelledError, FootageError
from kfmocap.core.runtime.output_files import files
from kfmocap.core.tracking.results import journal
from tiny_shot import assert_refused, broken, track

pytest_plugins = ("tiny_shot_fixtures",)


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_signals_end_a_run_and_leave_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str, code: int
) -> None:
    number = getattr(signal, name)
    before = signal.getsignal(number)
    monkeypatch.setattr(tracked_files, "track", lambda *_, **__: signal.raise_signal(number))
    assert track(folder) == code
    assert signal.getsignal(number) is before
    assert capsys.readouterr().err == "kfmocap: interrupted, nothing was written\n"
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]
    assert not list(folder.glob(".kfmocap-*"))


def test_an_interrupt_that_a_library_turns_into_an_error_of_its_own_remains_one(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """NumPy says that arrays cannot be compared where a signal comes while it compares records."""

    def compared(*_: object, **__: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as interrupt:
            raise TypeError("Cannot compare structured arrays") from interrupt

    monkeypatch.setattr(tracked_files, "track", compared)
    assert track(folder) == 143
    assert capsys.readouterr().err == "kfmocap: interrupted, nothing was written\n"
    monkeypatch.setattr(tracked_files, "track", broken(TypeError("a fault of ours")))
    with pytest.raises(TypeError, match="a fault of ours"):
        track(folder)


def test_an_interrupt_after_the_results_says_so(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(track_command, "report_lines", lambda *_: signal.raise_signal(signal.SIGINT))
    assert track(folder) == 130
    assert "kfmocap: interrupted when the results had been written" in capsys.readouterr().err
    assert (folder / "out" / "tiny.trc").is_file()


def test_an_interrupt_while_the_report_is_still_temporary_says_that_nothing_was_written(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    put = files.put_file
    monkeypatch.setattr(files, "put_file", lambda *args: (signal.raise_signal(signal.SIGTERM), put(*args))[1])
    assert track(folder) == 143
    assert "interrupted, nothing was written" in capsys.readouterr().err
    assert not (folder / "out" / "report.json").exists()


def test_an_interrupt_just_after_the_results_were_put_in_place_says_that_they_were(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    discard, came = journal.Journal.discard, []

    def interrupted(self: journal.Journal) -> None:
        discard(self)
        if (folder / "out" / "report.json").exists() and not came:
            came.append(signal.raise_signal(signal.SIGTERM))

    monkeypatch.setattr(journal.Journal, "discard", interrupted)
    assert track(folder) == 143
    assert "interrupted when the results had been written" in capsys.readouterr().err


def test_an_error_while_tracking_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracked_files, "track", broken(FootageError("it breaks off at frame 3", where="a.mp4")))
    assert_refused(folder, capsys, track(folder), "a.mp4: it breaks off at frame 3")
    monkeypatch.setattr(tracked_files, "track", broken(CancelledError()))
    assert_refused(folder, capsys, track(folder), "cancelled")


def test_an_interrupt_exits_with_130_and_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracked_files, "track", broken(KeyboardInterrupt()))
    assert track(folder) == 130
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]
