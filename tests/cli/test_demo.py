"""`kfmocap demo`: its footage is fetched once, and without a connection another example takes its place."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from kfmocap.__main__ import main
from kfmocap.cli import example_footage

pytest_plugins = ("tiny_shot_fixtures",)


@pytest.fixture
def examples(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The demo's examples, played by the tiny shot, with an empty cache."""
    root = folder / "examples"
    for name in ("beam", "walk"):
        (root / name).mkdir(parents=True)
        for file in ("shot.toml", "calibration.toml", "landmarks.trc"):
            (root / name / file).write_bytes((folder / file).read_bytes())
    for image in folder.glob("footage_*.png"):
        (root / "walk" / image.name).write_bytes(image.read_bytes())
    (root / "beam" / "SHA256SUMS").write_text("00  footage_00.png\n")
    monkeypatch.setattr(example_footage, "_EXAMPLES", root)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    return root


def test_the_demo_falls_back_to_the_rendered_example(
    folder: Path, examples: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def offline(command, **_):
        return subprocess.CompletedProcess(command, 1, "", "ERROR: no network\n")

    monkeypatch.setattr(example_footage.subprocess, "run", offline)
    assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    captured = capsys.readouterr()
    assert "no network" in captured.err
    assert "rendered example instead" in captured.err
    assert "mm (mean) from the reference" in captured.out
    assert (folder / "out" / "tiny.trc").is_file()


def test_the_demo_fetches_its_footage_once_and_checks_it(
    folder: Path, examples: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import hashlib
    import zipfile

    calls = []

    def pip(command, **_):
        calls.append(command)
        with zipfile.ZipFile(Path(command[command.index("--dest") + 1]) / "package.whl", "w") as wheel:
            for image in folder.glob("footage_*.png"):
                wheel.write(image, f"Pose2Sim/Demo_SinglePerson/videos/{image.name}")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(example_footage.subprocess, "run", pip)
    images = sorted(folder.glob("footage_*.png"))
    sums = [f"{hashlib.sha256(i.read_bytes()).hexdigest()}  {i.name}\n" for i in images]
    (examples / "beam" / "SHA256SUMS").write_text("".join(sums))
    for _ in range(2):
        assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    assert len(calls) == 1
    assert "pose2sim==0.10.49" in calls[0]
    assert "instead" not in capsys.readouterr().err

    (examples / "beam" / "SHA256SUMS").write_text("".join(sums).replace(sums[0][:64], "0" * 64))
    assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    assert "another file than expected" in capsys.readouterr().err
