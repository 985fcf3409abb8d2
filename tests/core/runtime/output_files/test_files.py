"""Results appear together or not at all, whatever ends the program, and nothing of it stays behind."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from kfmocap.core.errors import OutputError
from kfmocap.core.runtime.interrupts import WRITTEN_NOTE, Interruptions, held_signals
from kfmocap.core.runtime.output_files import atomic_placement
from kfmocap.core.runtime.output_files.files import check_writable, replacing, staged, together

RESULTS = ("a.trc", "b.bvh", "c.json")
STEPS = ("rename", "replace", "link", "unlink", "fsync", "rmdir")
"""Calls of the system before each of which a run is killed."""

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")


def contents(folder: Path) -> dict[str, str]:
    return {file.name: file.read_text() for file in folder.iterdir() if file.is_file()}


def write(folder: Path, text: str) -> None:
    with staged(folder) as stage:
        for name in RESULTS:
            (stage / name).write_text(text)


def leftovers(folder: Path) -> list[Path]:
    return list(folder.rglob(".kfmocap-*"))


def new_folder(out: Path) -> None:
    """Nothing is there yet."""


def plain_folder(out: Path) -> None:
    """Old results and somebody's file."""
    out.mkdir()
    for name in (*RESULTS, "notes.txt"):
        (out / name).write_text("old")


def folder_of_folders(out: Path) -> None:
    """It cannot be exchanged as a whole."""
    plain_folder(out)
    (out / "pictures").mkdir()


KINDS = [new_folder, plain_folder, folder_of_folders]


@pytest.mark.parametrize("kind", KINDS)
def test_results_replace_the_old_ones_and_leave_other_files(tmp_path: Path, kind) -> None:
    kind(tmp_path / "out")
    write(tmp_path / "out", "new")
    found = contents(tmp_path / "out")
    assert found.pop("notes.txt", "old") == "old"
    assert found == dict.fromkeys(RESULTS, "new")
    assert not leftovers(tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems may not exchange folders")
def test_a_folder_of_plain_files_is_exchanged_in_one_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain_folder(tmp_path / "out")
    (tmp_path / "out").chmod(0o750)
    monkeypatch.setattr(atomic_placement, "move_files", lambda *_: pytest.fail("files were moved one by one"))
    write(tmp_path / "out", "new")
    assert contents(tmp_path / "out") == {**dict.fromkeys(RESULTS, "new"), "notes.txt": "old"}
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o750


def test_the_working_folder_stays_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain_folder(tmp_path / "out")
    before = (tmp_path / "out").stat().st_ino
    monkeypatch.chdir(tmp_path / "out")
    write(Path(), "new")
    assert (tmp_path / "out").stat().st_ino == before
    assert contents(tmp_path / "out")["a.trc"] == "new"


def child(work) -> int:
    """Do work in a process of its own; returns its exit status as os.waitpid gives it."""
    process = os.fork()
    if process == 0:
        try:
            work()
        finally:
            os._exit(1 if sys.exc_info()[0] else 0)
    return os.waitpid(process, 0)[1]


@needs_fork
@pytest.mark.parametrize("kind", KINDS)
def test_a_run_killed_before_any_step_leaves_all_old_or_all_new_to_the_next(tmp_path: Path, kind) -> None:
    """A kill before the n-th call that changes the disk, for every n."""
    states = set()
    for n in range(1, 60):
        out = tmp_path / str(n) / "out"
        out.parent.mkdir()
        kind(out)

        def killed(out: Path = out, left: int = n) -> None:
            def dying(call):
                def step(*args, **kwargs):
                    nonlocal left
                    left -= 1
                    if left == 0:
                        os.kill(os.getpid(), signal.SIGKILL)
                    return call(*args, **kwargs)

                return step

            for name in STEPS:
                setattr(os, name, dying(getattr(os, name)))
            write(out, "new")

        ended = child(killed) == 0
        if kind is not folder_of_folders and out.exists():  # before anything is done about it
            assert len({text for name, text in contents(out).items() if name in RESULTS}) == 1
        check_writable(out)
        assert not leftovers(tmp_path)
        found = contents(out) if out.exists() else {}
        assert found.pop("notes.txt", "old") == "old"
        assert set(found) in (set(), set(RESULTS))
        states.add(frozenset(found.values()))
        if ended:
            break
    assert ended
    assert states == {frozenset({"new"}), frozenset() if kind is new_folder else frozenset({"old"})}


@pytest.mark.parametrize("kind", KINDS)
def test_an_interrupt_while_results_are_put_in_place_waits_for_them(
    tmp_path: Path, kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind(tmp_path / "out")
    for name in ("rename", "replace", "link"):
        call = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *args, call=call: (signal.raise_signal(signal.SIGINT), call(*args))[1])
    with pytest.raises(KeyboardInterrupt) as interrupt, Interruptions():
        write(tmp_path / "out", "new")
    monkeypatch.undo()
    found = contents(tmp_path / "out") if (tmp_path / "out").exists() else {}
    results = {text for name, text in found.items() if name in RESULTS}
    assert (results == {"new"}) == (WRITTEN_NOTE in getattr(interrupt.value, "__notes__", []))
    assert len(results) < 2
    assert not leftovers(tmp_path)


def test_signals_are_held_and_then_have_their_effect() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), Interruptions() as interruptions, held_signals():
        signal.raise_signal(signal.SIGTERM)
        done.append("work")
    assert done == ["work"]
    assert interruptions.exit_code == 143


def test_an_error_leaves_everything_as_it_was(tmp_path: Path) -> None:
    plain_folder(tmp_path / "out")
    with pytest.raises(ZeroDivisionError), staged(tmp_path / "out") as stage:
        (stage / "a.trc").write_text("new")
        raise ZeroDivisionError
    assert set(contents(tmp_path / "out").values()) == {"old"}
    assert not leftovers(tmp_path)


def test_files_and_folders_of_one_run_appear_together(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"b\.toml"), together() as outputs:
        (outputs.folder(tmp_path / "report") / "a.json").write_text("new")
        outputs.file(tmp_path / "b.toml").write_text("new")
        (tmp_path / "b.toml").mkdir()  # while the work is done
    assert not (tmp_path / "report").exists()
    assert not leftovers(tmp_path)


def test_what_killed_runs_left_is_removed_but_not_what_is_being_written(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from kfmocap.core.runtime.output_files.files import staged\n"
        "with staged(Path(sys.argv[1])): print('there', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "out")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "there\n"
        check_writable(tmp_path / "out")
        assert len(leftovers(tmp_path)) == 1
        other.kill()
    assert len(leftovers(tmp_path)) == 1
    check_writable(tmp_path / "out")
    assert not leftovers(tmp_path)


def test_somebody_elses_plan_moves_nothing_elsewhere(tmp_path: Path) -> None:
    place = tmp_path / "out" / ".kfmocap-planted"
    (place / "results").mkdir(parents=True)
    (place / "results" / "authorized_keys").write_text("mine")
    (place / "lock").touch()
    (place / "moving").write_text("../elsewhere")
    (tmp_path / "elsewhere").mkdir()
    write(tmp_path / "out", "new")
    assert not list((tmp_path / "elsewhere").iterdir())
    assert not place.exists()


def test_temporary_names_cannot_be_foreseen(tmp_path: Path) -> None:
    names = set()
    for _ in range(3):
        with replacing(tmp_path / "a.trc") as temporary:
            names.add(temporary.parent.parent.name)
            temporary.write_text("new")
    assert len(names) == 3
    assert not any(str(os.getpid()) in name for name in names)


@pytest.mark.parametrize("taken", ["a.trc", "b.bvh"])
def test_a_folder_in_the_way_is_seen_before_the_work(tmp_path: Path, taken: str) -> None:
    (tmp_path / "out" / taken).mkdir(parents=True)
    with pytest.raises(OutputError, match="a folder is in the way"), staged(tmp_path / "out", RESULTS):
        pytest.fail("the work was begun")


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege there")
@pytest.mark.parametrize(("link", "out"), [("out", "out"), ("home", "home/out"), ("out", "out/")])
@pytest.mark.parametrize("target", ["nowhere", "out", "home"])
def test_a_link_that_leads_nowhere_is_seen_before_the_work(tmp_path: Path, link: str, out: str, target: str) -> None:
    (tmp_path / link).symlink_to(tmp_path / target)  # which is not there, or leads to itself
    with pytest.raises(OutputError, match=f"{link}: .*cannot be written|{link}: is a symbolic link that leads nowhere"):
        check_writable(tmp_path / out)
    assert [entry.name for entry in tmp_path.iterdir()] == [link]


def test_a_file_that_cannot_be_written_whole_replaces_nothing(tmp_path: Path) -> None:
    plain_folder(tmp_path / "out")
    code = (
        "import resource, signal, sys; from pathlib import Path; from kfmocap.core.errors import OutputError\n"
        "from kfmocap.core.runtime.output_files.files import staged\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))\n"
        "try:\n"
        "    with staged(Path(sys.argv[1])) as stage:\n"
        "        (stage / 'a.trc').write_text('new')\n"
        "        (stage / 'b.bvh').write_text(10000 * 'new')\n"
        "except OutputError as error: sys.exit(str(error))"
    )
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "out"], capture_output=True, text=True)
    assert run.returncode == 1
    assert "out: cannot be written: File too large" in run.stderr
    assert "Traceback" not in run.stderr
    assert set(contents(tmp_path / "out").values()) == {"old"}
    assert not leftovers(tmp_path)


def test_files_beside_a_workplace_that_is_gone_are_removed(tmp_path: Path) -> None:
    (tmp_path / ".kfmocap-gone.blend").touch()
    with replacing(tmp_path / "a.blend") as temporary:
        beside = tmp_path / f"{temporary.parents[1].name}.blend"
        beside.touch()
        check_writable(tmp_path / "out")
        assert beside.exists()
        temporary.touch()
    assert not (tmp_path / ".kfmocap-gone.blend").exists()


def test_a_file_that_vanishes_while_results_are_made_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(OutputError, match=r"out: cannot be written: No such file or directory: .*input\.mp4"),
        staged(tmp_path / "out"),
    ):
        (tmp_path / "input.mp4").read_bytes()


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.ENOSPC, "(make room on its disk, or choose another one)"),
        (errno.EACCES, "(choose a folder that you may write to, or close the file where it is open)"),
        (errno.EROFS, "(choose a folder that you may write to)"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_what_to_do_is_said_where_a_file_cannot_be_written(tmp_path: Path, number: int, said: str) -> None:
    with pytest.raises(OutputError) as caught, staged(tmp_path / "out"):
        raise OSError(number, os.strerror(number))
    assert str(caught.value) == f"{tmp_path / 'out'}: cannot be written: {os.strerror(number)}" + (
        f" {said}" if said.startswith("(") else ""
    )


def test_what_could_not_be_written_is_named_by_its_final_place(tmp_path: Path) -> None:
    """Who writes the pictures knows only the folder that they are written to first, which is gone by then."""
    out = tmp_path / "out"
    with pytest.raises(OutputError) as caught, staged(out) as stage:
        raise OutputError("cannot be written: No space left on device", where=str(stage / "overlay.png"))
    assert str(caught.value) == f"{out / 'overlay.png'}: cannot be written: No space left on device"
    with pytest.raises(OutputError) as caught, replacing(tmp_path / "a.json") as temporary:
        raise OutputError("cannot be written", where=str(temporary))
    assert caught.value.where == str(tmp_path / "a.json")
    with pytest.raises(OutputError) as caught, staged(out):
        raise OutputError("cannot be written", where="elsewhere.mp4")
    assert caught.value.where == "elsewhere.mp4"
