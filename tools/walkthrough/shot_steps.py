"""A shot in one go, counting clicks: from the installed extension to a tracked, reviewed, corrected, exported motion.

Run by `tools/tutorial.py --steps walk` or `beam`; the arguments after `--` are the folder with the examples and the
extension's zip, and the example's name. Clicks on joints are not counted: they are the work itself.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen
import file_steps as files
import tutorial_steps as tutorial
from blender_screen import Waits, click, expect, find, until
from tool_steps import key_frames
from tutorial_steps import WORK, carry_out, idle, picture, scene, sidebar

EXAMPLE = sys.argv[-1]
AT_MOST = 12
"""Clicks and drops from an empty scene to exported files."""
KEY_ROW = 50
"""Least height of a timeline below whose frame numbers keys are seen, pixels."""


class ClickCount:
    """Clicks, and drops, that a user needs beside those on joints."""

    def __init__(self) -> None:
        self.made: list[str] = []

    def click(self, label: str, **where: object) -> Waits:
        """Click on a label; the other arguments are those of `screen.find`."""
        self.made.append(label)
        yield from click(label, **where)

    def only(self, section: str) -> Waits:
        """Ctrl-click on a section's title."""
        self.made.append(section)
        yield from tutorial.only(section)


def shot() -> Waits:
    """The example, from the zip's first start to files for other programs."""
    counted, joints = ClickCount(), tutorial.truth(EXAMPLE)
    yield from files.install()
    counted.made += ["KF Mocap", "the shot file, dropped"]
    yield from files.drop(WORK / EXAMPLE / "shot.toml")
    yield from until(lambda: len(scene().kfmocap.performers) == 1)
    yield 1.0
    expect(tutorial.timeline().height >= KEY_ROW, "the timeline is high enough to show keys")
    yield from counted.click("Track All")
    yield from until(lambda: idle() and tutorial.tracked_keys(), 900)
    yield from picture(f"{EXAMPLE}_tracked")

    x, y = find("One more key pose would help most at", within=sidebar())
    counted.made.append("the first suggestion")
    yield from screen.click_at((x, y + 20))
    frame = scene().frame_current
    before = key_frames()
    yield from counted.only("Key Poses")
    counted.made.append("Place Joints")
    yield from tutorial.pose(frame - 1, joints)
    expect(key_frames() == sorted([*before, frame]), f"the suggested frame {frame} has a key pose")
    yield from counted.only("Track")
    yield from counted.click("Track Changes")
    yield 2.0
    yield from until(idle, 900)
    expect(tutorial.tracked_keys(), "it is tracked again")
    expect(frame in key_frames(), "the key pose stays")
    yield from picture(f"{EXAMPLE}_corrected")

    yield from counted.only("Export")
    yield from counted.click("Export", within=tutorial.below("Root Motion"))
    height, width = screen.screenshot().shape[:2]
    yield from counted.click("Export", within=(width // 2, height - 60, width, height))
    yield from until(lambda: scene().kfmocap.export.written)
    written = [Path(line) for line in scene().kfmocap.export.written.splitlines()]
    expect({path.suffix for path in written} >= {".bvh", ".fbx"}, "BVH and FBX are written")
    expect(all(path.parent == WORK / EXAMPLE and path.stat().st_size for path in written), "beside the footage")
    yield from picture(f"{EXAMPLE}_exported")
    expect(len(counted.made) <= AT_MOST, f"{len(counted.made)} clicks: {', '.join(counted.made)}")


if __name__ == "__main__":
    carry_out(shot())
