"""Make the pictures of docs/tutorial.md, and with `--steps rigs` those of docs/retargeting.md: follow these pages in
Blender with mouse and keyboard, taking screenshots.

Other steps go through the animator's tools instead, and check what each does. It needs the Blender application, Xvfb,
xdotool and ImageMagick. If they are installed in another root file system, `--run` gives the command that runs a
program there; it must see the work folder under the same path.

    python tools/tutorial.py --zip dist/kfmocap-0.1.0-linux_x64.zip

For a version that is there as the bpy module only, tools/windowed_blender.py is the command that starts it:

    python tools/tutorial.py --steps walk --zip ... --blender ".venv-4.5/bin/python tools/windowed_blender.py"
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[1]
STEPS = {"tutorial": "tutorial", "rigs": "rig", "tools": "tool", "walk": "shot", "beam": "shot"}
"""Scripts in tools/walkthrough, without their ending `_steps.py`."""
PAGES = {"tutorial": "tutorial", "rigs": "retargeting"}
"""Folders of docs that get the pictures of some of them."""
SIZE = (1440, 900)
"""Width and height of Blender's window, pixels."""
WIDTH, QUALITY = 1200, 78
"""Width in pixels and JPEG quality of the pictures on the page."""


def prepare(work: Path, extension: Path) -> None:
    """Copy everything that Blender needs into one folder."""
    shutil.rmtree(work, ignore_errors=True)
    for folder in ("walkthrough", "user"):
        (work / folder).mkdir(parents=True)
    for script in (ROOT / "tools" / "walkthrough").glob("*.py"):
        shutil.copy(script, work / "walkthrough")
    shutil.copytree(ROOT / "examples" / "walk", work / "walk")
    if (ROOT / "examples" / "beam" / "cam01.mp4").exists():
        shutil.copytree(ROOT / "examples" / "beam", work / "beam")
    shutil.copy(extension, work / "kfmocap.zip")


def run_blender(work: Path, steps: str, prefix: str, blender: str, seconds: int) -> int:
    """Carry out steps in Blender, which a command starts; returns its exit code."""
    width, height = SIZE
    command = [
        *shlex.split(prefix.format(work=work)),
        *("xvfb-run", "-a", "-s", f"-screen 0 {width}x{height}x24", "timeout", str(seconds)),
        *(*shlex.split(blender), "--gpu-backend", "opengl", "--window-geometry", "0", "0", str(width), str(height)),
        *("--python", str(work / "walkthrough" / f"{STEPS[steps]}_steps.py"), "--", str(work), steps),
    ]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(work / "user"), "KEEP": "BLENDER_USER_RESOURCES"}
    return subprocess.run(command, env=environment, check=False).returncode


def main() -> int:
    """Follow the tutorial in Blender and save its pictures for the page; the exit code is Blender's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--zip", type=Path, required=True, help="the extension, built for that Blender's Python")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "tutorial")
    parser.add_argument("--steps", choices=STEPS, default="tutorial", help="which ones; those of a page have --out")
    parser.add_argument("--out", type=Path, help="by default the page's folder in docs")
    parser.add_argument(
        "--run",
        default="",
        metavar="COMMAND",
        help="prefix that runs a command where Blender is installed; {work} is the work folder",
    )
    parser.add_argument("--blender", default="blender", metavar="COMMAND", help="what starts Blender")
    parser.add_argument("--seconds", type=int, default=1800, help="time limit")
    arguments = parser.parse_args()

    work = arguments.work.resolve()
    prepare(work, arguments.zip)
    code = run_blender(work, arguments.steps, arguments.run, arguments.blender, arguments.seconds)
    if code:
        print(f"The walkthrough failed: see {work / 'pictures' / 'failed.png'}")
        return code
    if arguments.steps not in PAGES:
        return 0
    out = arguments.out or ROOT / "docs" / PAGES[arguments.steps]
    out.mkdir(parents=True, exist_ok=True)
    for picture in sorted((work / "pictures").glob("*.png")):
        image = cv2.imread(str(picture))
        image = cv2.resize(image, (WIDTH, round(WIDTH * image.shape[0] / image.shape[1])), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(out / f"{picture.stem}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return 0


if __name__ == "__main__":
    sys.exit(main())
