"""What Place Joints shows over the footage: what the next click or drag takes is named beside the mouse."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.kfmocap_addon.operators.posing import placing_display  # noqa: E402
from kfmocap.kfmocap_addon.overlays import mark_drawing  # noqa: E402
from kfmocap.kfmocap_addon.viewports import screens  # noqa: E402

pytestmark = pytest.mark.blender

REGION = SimpleNamespace(x=100, y=50, width=400, height=300)
LOOK = SimpleNamespace(
    region=REGION,
    area=None,
    view=SimpleNamespace(name="cam01"),
    position_of=lambda point: point,
    position=lambda place: place,
)


class Drawn:
    """What was drawn: the texts, and how many rings and lines."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.texts: list[str] = []
        self.rings = self.lines = 0
        monkeypatch.setattr(mark_drawing, "ring", self._ring)
        monkeypatch.setattr(mark_drawing, "lines", self._lines)
        monkeypatch.setattr(mark_drawing, "width_of", lambda text: 8.0 * len(text))
        monkeypatch.setattr(mark_drawing, "label", lambda text, *_: self.texts.append(text))
        monkeypatch.setattr(screens, "uncovered_part", lambda _: (100, 50, 500, 350))

    def _ring(self, *_: object) -> None:
        self.rings += 1

    def _lines(self, *_: object) -> None:
        self.lines += 1


def placing(marked: Sequence[str] = ()) -> SimpleNamespace:
    joints = {name: SimpleNamespace(x=20.0 * k, y=10.0) for k, name in enumerate(("LWrist", "RElbow", "LKnee"))}
    marks = {("cam01", name): None for name in marked}
    return SimpleNamespace(
        joints=lambda: joints, marks=marks, alternatives=[], place_of=lambda _view, name: joints[name]
    )


@pytest.mark.parametrize(
    ("pointer", "asked", "taken", "texts"),
    [
        ((150, 100), "LWrist", "RElbow", ["Left Wrist", "drag: Right Elbow"]),
        ((150, 100), "LWrist", "LWrist", ["Left Wrist"]),
        ((150, 100), None, "RElbow", ["drag: Right Elbow"]),
        ((90, 100), "LWrist", "RElbow", []),
    ],
)
def test_what_a_click_and_a_drag_take_is_named_beside_the_mouse(
    monkeypatch: pytest.MonkeyPatch, pointer: tuple[int, int], asked: str | None, taken: str | None, texts: list[str]
) -> None:
    """A drag of the joint that is asked for is the same as the click; outside of the view nothing is named."""
    drawn = Drawn(monkeypatch)
    placing_display.draw(placing(), LOOK, pointer, asked=asked, taken=taken)
    assert drawn.texts == texts
    assert drawn.rings == 3


def test_marks_of_the_view_are_joined_to_their_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = Drawn(monkeypatch)
    placing_display.draw(placing(["LKnee"]), LOOK, (0, 0), asked=None, taken=None)
    assert (drawn.rings, drawn.lines) == (3, 1)


@pytest.mark.parametrize(("pointer", "name"), [((141, 62), "LKnee"), ((110, 60), "LWrist"), ((300, 200), None)])
def test_a_handle_is_taken_from_near(pointer: tuple[int, int], name: str | None) -> None:
    assert placing_display.handle_under(placing(), LOOK, pointer) == name
