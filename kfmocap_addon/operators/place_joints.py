"""Place Joints: the body is posed by clicking its joints in the footage; and their marks are taken away."""

from __future__ import annotations

import bpy

from ..scene_io import active_performer, joint_marks
from ..viewports import viewport
from .conditions import Conditional, has_performer
from .look_through import show_view
from .reporting import reported

_NEAR, _CLICK = 14, 4  # pixels: how near a handle is meant, how far the mouse of a click moves
_VIEW = ("MIDDLEMOUSE", "WHEEL", "NUMPAD_", "TRACKPAD", "MOUSEPAN", "MOUSEZOOM", "HOME", "NDOF", "TIMER", "WINDOW")
_HINT = (
    "Click or drag: {asked}   Drag a handle: that joint   Tab: next joint   X: take the mark away   F: flip the limb   "
    "Page Up/Down: other view   Ctrl Z: last mark   Enter: key the pose   Esc: cancel   ({count} marks, {misfit})"
)


def _has_calibrated_camera(context: bpy.types.Context) -> str:
    if any(view.camera is not None and view.is_calibrated for view in context.scene.kfmocap.views):
        return ""
    return "No view has a calibrated camera yet: clicks need one"


class PlaceJoints(Conditional, bpy.types.Operator):
    """Pose the body by clicking joints in the footage, in one camera or several: it follows with every click. Two
    cameras tell where a joint is; with one its depth stays as in the pose that is shown. Enter, or a click beside the
    picture, keys the pose. With bones selected in pose mode, these alone are posed and keyed"""

    bl_idname = "kfmocap.place_joints"
    bl_label = "Place Joints"
    bl_options = {"UNDO"}
    conditions = (has_performer, _has_calibrated_camera)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Without a mouse: pose the body on the marks that this frame has."""
        with reported(self) as outcome:
            self._begin(context)
            try:
                self._placing.key()
            except Exception:
                self._placing.restore()
                raise
        return outcome.value

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        with reported(self) as outcome:
            self._begin(context)
        if outcome.value != {"FINISHED"}:
            return outcome.value
        if context.screen.is_animation_playing:
            bpy.ops.screen.animation_cancel(restore_frame=False)
        self._look_through_one(context)
        self._asked: dict[str, str] = {}
        self._press: tuple[int, int] | None = None
        self._dragged: str | None = None
        self._pointer = event.mouse_x, event.mouse_y
        self._drawing = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.window.cursor_modal_set("CROSSHAIR")
        context.window_manager.modal_handler_add(self)
        self._tell(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._pointer = event.mouse_x, event.mouse_y
        try:
            with reported(self) as outcome:
                result = self._handled(context, event)
        except Exception:
            self._cancelled(context)
            raise
        if outcome.value != {"FINISHED"}:
            return self._cancelled(context)
        if not result & {"FINISHED", "CANCELLED"}:
            self._tell(context)
        return result

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender closes its file or itself."""
        self._cancelled(context)

    def _begin(self, context: bpy.types.Context) -> None:
        from ..editing.click_posing import Placing

        slot = active_performer.chosen(context)
        self._placing = Placing(context.scene, slot, active_performer.chosen_bones(context, slot.armature))

    def _handled(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "MOUSEMOVE":
            self._dragging(context)
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._released(context)
        elif event.value == "PRESS":
            return self._pressed(context, event)
        elif event.type.startswith(_VIEW):
            return {"PASS_THROUGH"}
        return {"RUNNING_MODAL"}

    def _pressed(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        look, kind = self._look(context), event.type
        if kind == "LEFTMOUSE" and (look is None or not self._is_inside(look)):
            return self._confirmed(context) | ({"PASS_THROUGH"} if look is None else set())
        if kind == "LEFTMOUSE":
            self._press = self._pointer
        elif kind in ("RET", "NUMPAD_ENTER"):
            return self._confirmed(context)
        elif kind in ("ESC", "RIGHTMOUSE"):
            return self._cancelled(context)
        elif kind == "Z" and event.ctrl:
            self._placing.undo()
        elif kind in ("PAGE_UP", "PAGE_DOWN"):
            self._look_on(context, -1 if kind == "PAGE_UP" else 1)
        elif kind == "TAB" and look is not None:
            self._ask_on(look.view.name, -1 if event.shift else 1)
        elif kind in ("X", "DEL", "F") and look is not None:
            self._edited(look, flip=kind == "F")
        elif kind.startswith(_VIEW):
            return {"PASS_THROUGH"}
        return {"RUNNING_MODAL"}

    def _dragging(self, context: bpy.types.Context) -> None:
        if self._press is None:
            return
        moved = max(abs(a - b) for a, b in zip(self._pointer, self._press, strict=True))
        look = self._look(context)
        if look is None or (self._dragged is None and moved < _CLICK):
            return
        if self._dragged is None:
            self._dragged = self._near(look, self._press) or self._asked_in(look.view.name)
            if self._dragged is None:
                return
            self._placing.remember()
        self._placing.mark(look.view.name, self._dragged, self._place(look, self._pointer), dragging=True)

    def _released(self, context: bpy.types.Context) -> None:
        press, landmark, look = self._press, self._dragged, self._look(context)
        self._press = self._dragged = None
        if press is None or look is None:
            return
        if landmark is None:
            landmark = self._asked_in(look.view.name)
            if landmark is None:
                return
            self._placing.remember()
        self._placing.mark(look.view.name, landmark, self._place(look, self._pointer))
        if self._asked.get(look.view.name) == landmark:
            del self._asked[look.view.name]

    def _edited(self, look: viewport.Look, flip: bool) -> None:
        landmark = self._near(look, self._pointer)
        if landmark is not None and flip:
            self._placing.flip(look.view.name, landmark)
        elif landmark is not None and (look.view.name, landmark) in self._placing.marks:
            self._placing.unmark(look.view.name, landmark)

    def _asked_in(self, view: str) -> str | None:
        """The joint that the next click is for."""
        missing = self._placing.missing(view)
        asked = self._asked.get(view)
        return asked if asked in missing else missing[0] if missing else None

    def _ask_on(self, view: str, step: int) -> None:
        missing = self._placing.missing(view)
        if missing:
            self._asked[view] = missing[(missing.index(self._asked_in(view)) + step) % len(missing)]

    def _near(self, look: viewport.Look, pointer: tuple[int, int]) -> str | None:
        """The landmark whose handle is under the mouse: its mark, where it has one, or the pose's joint."""
        x, y = pointer[0] - look.region.x, pointer[1] - look.region.y
        handles = {name: look.position_of(point) for name, point in self._placing.joints().items()}
        for view, name in self._placing.marks:
            if view == look.view.name:
                handles[name] = look.position(self._placing.place_of(view, name))
        far = {name: (at.x - x) ** 2 + (at.y - y) ** 2 for name, at in handles.items() if at is not None}
        nearest = min(far, key=far.__getitem__, default=None)
        return nearest if nearest is not None and far[nearest] <= _NEAR**2 else None

    def _look(self, context: bpy.types.Context) -> viewport.Look | None:
        look = viewport.look_under(context, *self._pointer)
        return look if look is not None and look.view.name in self._placing.views() else None

    def _place(self, look: viewport.Look, pointer: tuple[int, int]) -> tuple[float, float]:
        return look.place(pointer[0] - look.region.x, pointer[1] - look.region.y)

    def _is_inside(self, look: viewport.Look) -> bool:
        return self._placing.is_inside(look.view.name, self._place(look, self._pointer))

    def _look_through_one(self, context: bpy.types.Context) -> None:
        """Where no 3D view looks through a camera, the one that the tool was called from does."""
        areas = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
        if not any(viewport.look_of(context.scene, a, a.regions[-1], a.spaces.active) for a in areas):
            self._look_on(context, 0)

    def _look_on(self, context: bpy.types.Context, step: int) -> None:
        usable = [i for i, slot in enumerate(context.scene.kfmocap.views) if slot.name in self._placing.views()]
        shown = context.scene.kfmocap.shown_view
        show_view(context, usable[(usable.index(shown) + step if shown in usable else 0) % len(usable)])
        # Another camera has Blender evaluate the keys anew.
        context.view_layer.update()
        self._placing.show()

    def _tell(self, context: bpy.types.Context) -> None:
        look, placing = self._look(context), self._placing
        asked = self._asked_in(look.view.name) if look is not None else None
        text = _HINT.format(
            asked=_spoken(asked) if asked else "-",
            count=len(placing.marks),
            misfit=f"{1000 * placing.fitted.misfit:.0f} mm off",
        )
        context.workspace.status_text_set(text)
        viewport.redraw(context)

    def _draw(self) -> None:
        from ..overlays import mark_drawing as overlay

        context = bpy.context
        look = viewport.look_of(context.scene, context.area, context.region, context.space_data)
        if look is None or look.view.name not in self._placing.views():
            return
        for name, point in self._placing.joints().items():
            at = look.position_of(point)
            if at is None:
                continue
            colour = overlay.colour_of(name)
            overlay.ring(at, colour)
            if (look.view.name, name) in self._placing.marks:
                marked = look.position(self._placing.place_of(look.view.name, name))
                if marked is not None:
                    overlay.lines([at, marked], colour)
        x, y = self._pointer[0] - context.region.x, self._pointer[1] - context.region.y
        if 0 <= x < context.region.width and 0 <= y < context.region.height:
            name = self._dragged or (None if self._press else self._near(look, self._pointer))
            asked = self._asked_in(look.view.name)
            if asked is not None:
                overlay.label(_spoken(asked), (x + 14, y + 12), overlay.colour_of(asked))
            if name is not None and name != asked:
                overlay.label(f"drag: {_spoken(name)}", (x + 14, y - 22), overlay.colour_of(name))

    def _confirmed(self, context: bpy.types.Context) -> set[str]:
        if not self._placing.marks:
            return self._cancelled(context)
        self._placing.key()
        self._ended(context)
        count, off = len(self._placing.marks), 1000 * self._placing.fitted.misfit
        self.report({"INFO"}, f"Key pose on frame {self._placing.frame} from {count} marks, {off:.0f} mm off")
        return {"FINISHED"}

    def _cancelled(self, context: bpy.types.Context) -> set[str]:
        self._placing.restore()
        self._ended(context)
        return {"CANCELLED"}

    def _ended(self, context: bpy.types.Context) -> None:
        bpy.types.SpaceView3D.draw_handler_remove(self._drawing, "WINDOW")
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        viewport.redraw(context)


def _has_marks(context: bpy.types.Context) -> str:
    return "" if len(active_performer.chosen(context).marks) else "No joint is marked"


class ClearMarks(Conditional, bpy.types.Operator):
    """Take all clicked joints of the chosen performer on this frame away. Poses stay"""

    bl_idname = "kfmocap.clear_marks"
    bl_label = "Clear Marks"
    bl_options = {"REGISTER", "UNDO"}
    conditions = (has_performer, _has_marks)

    def execute(self, context: bpy.types.Context) -> set[str]:
        slot, frame = active_performer.chosen(context), context.scene.frame_current
        if not joint_marks.on_frame(slot, frame):
            self.report({"WARNING"}, f"No joint is marked on frame {frame}")
            return {"CANCELLED"}
        joint_marks.put(slot, frame, {})
        viewport.redraw(context)
        return {"FINISHED"}


def _spoken(landmark: str) -> str:
    from ..editing.click_posing import spoken

    return spoken(landmark)


CLASSES = (PlaceJoints, ClearMarks)
