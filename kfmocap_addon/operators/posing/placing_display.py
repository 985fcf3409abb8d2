"""What Place Joints shows: handles, names and poses that look alike over the footage, and hints in the status bar.

Places under the mouse are found here, too: what is drawn there is what a click takes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...scene_io.body.sides import colour_of
from ...viewports import screens, viewport

if TYPE_CHECKING:
    from ...editing.click_posing import Placing

_NEAR = 14  # pixels: distance at which a handle is picked
_HINT = (
    "Click or drag: {asked}   Drag a handle: that joint   Tab: next joint   X: take the mark away   F: flip the limb   "
    "A: alternative   Page Up/Down: other view   Ctrl Z: last mark   Enter: key the pose   "
    "Esc: cancel   ({count} marks, {misfit})"
)
_AWAY = "The marks are on frame {frame}: go back there to go on   Enter: key the pose on frame {frame}   Esc: cancel"
_ASKING = "Discard the marks?   Right-click again or Esc: discard   Enter: key the pose   Anything else: go on"


def hint_at(placing: Placing, asked: str | None, *, away: bool, discards: bool) -> str:
    """Return the hint of the status bar.

    Parameters
    ----------
    placing : Placing
    asked : str or None
        The joint that the next click places.
    away : bool
        Whether another frame than that of the marks is shown.
    discards : bool
        Whether the tool asks if the marks shall be discarded.
    """
    if away:
        return _AWAY.format(frame=placing.frame)
    if discards:
        return _ASKING
    misfit = f"missed by {1000 * placing.fitted.misfit:.0f} mm"
    return _HINT.format(asked=_label(asked) if asked else "-", count=len(placing.marks), misfit=misfit)


def handle_under(placing: Placing, look: viewport.Look, pointer: tuple[int, int]) -> str | None:
    """Return the landmark whose handle is under the mouse: its mark if it has one, or else the pose's joint."""
    x, y = pointer[0] - look.region.x, pointer[1] - look.region.y
    handles = {name: look.position_of(point) for name, point in placing.joints().items()}
    for view, name in placing.marks:
        if view == look.view.name:
            handles[name] = look.position(placing.place_of(view, name))
    far = {name: (at.x - x) ** 2 + (at.y - y) ** 2 for name, at in handles.items() if at is not None}
    nearest = min(far, key=far.__getitem__, default=None)
    return nearest if nearest is not None and far[nearest] <= _NEAR**2 else None


def box_under(placing: Placing, look: viewport.Look, pointer: tuple[int, int]) -> int | None:
    """Return the index of the alternative whose box is under the mouse."""
    if not placing.alternatives:
        return None
    from ...overlays import alternative_boxes

    x, y = pointer[0] - look.region.x, pointer[1] - look.region.y
    return alternative_boxes.box_at(_boxes(placing, look), x, y)


def _boxes(placing: Placing, look: viewport.Look) -> list[tuple[float, float, float, float]]:
    """Return where in a view the boxes of the alternatives are."""
    from ...overlays import alternative_boxes

    at = [look.position_of(point) for point in placing.joints().values()]
    left, _, right, upper = screens.uncovered_part(look.area)
    return alternative_boxes.row_beside(
        [p for p in at if p is not None],
        len(placing.alternatives),
        upper - look.region.y,
        sides=(left - look.region.x, right - look.region.x),
    )


def draw(
    placing: Placing, look: viewport.Look, pointer: tuple[int, int], *, asked: str | None, taken: str | None
) -> None:
    """Draw rings on the joints, lines to their marks, the alternatives, and the names beside the mouse.

    Parameters
    ----------
    placing : Placing
    look : viewport.Look
    pointer : tuple of int
        Where the mouse is in the window, pixels.
    asked : str or None
        The joint that the next click places.
    taken : str or None
        The joint whose handle is dragged, or would be.
    """
    from ...overlays import mark_drawing as overlay

    for name, point in placing.joints().items():
        at = look.position_of(point)
        if at is None:
            continue
        colour = colour_of(name)
        overlay.ring(at, colour)
        if (look.view.name, name) in placing.marks:
            marked = look.position(placing.place_of(look.view.name, name))
            if marked is not None:
                overlay.lines([at, marked], colour)
    _draw_alternatives(placing, look)
    x, y = pointer[0] - look.region.x, pointer[1] - look.region.y
    inside = 0 <= x < look.region.width and 0 <= y < look.region.height
    if not inside or box_under(placing, look, pointer) is not None:
        return
    labels = [(_label(asked), asked, y + 12)] if asked is not None else []
    if taken is not None and taken != asked:
        labels.append((f"drag: {_label(taken)}", taken, y - 22))
    right = screens.uncovered_part(look.area)[2] - look.region.x
    for text, joint, height in labels:
        overlay.label(text, (overlay.beside(x, overlay.width_of(text), right), height), colour_of(joint))


def _draw_alternatives(placing: Placing, look: viewport.Look) -> None:
    if placing.alternatives:
        from ...overlays import alternative_boxes

        colours = [colour_of(part.name) for part in placing.body.parts]
        row = _boxes(placing, look)
        bones, centre = placing.bones_of_alternatives(), placing.centre_of(look.view.name)
        alternative_boxes.draw(row, bones, colours, centre, placing.alternative)


def _label(landmark: str) -> str:
    from ...editing.click_posing import landmark_label

    return landmark_label(landmark)
