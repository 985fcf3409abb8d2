"""Place Joints: posing the body by clicking its joints in the footage."""

from __future__ import annotations

import bpy

from ....core.errors import KeypointError
from ...scene_io import active_performer
from ...viewports import viewport
from ...viewports.navigation import navigates
from ..conditions import Conditional, has_performer, on_whole_frame, outside_shot
from ..footage.look_through import show_view
from ..reporting import reported
from .placing_display import box_under, draw, handle_under, hint_at

_CLICK = 4  # pixels: largest movement of a click
_ILL_SUITED, _MANY = 20, 10  # mm, marks: so many are rarely missed by more once the body's lengths are right
_VIEW = ("MIDDLEMOUSE", "WHEEL", "NUMPAD_", "TRACKPAD", "MOUSEPAN", "MOUSEZOOM", "HOME", "NDOF", "TIMER", "WINDOW")
_STEPS = ("LEFT_ARROW", "RIGHT_ARROW", "UP_ARROW", "DOWN_ARROW")  # through the frames
_SIDEBARS = ("N", "T")
_ENTER = ("RET", "NUMPAD_ENTER")


def _has_calibrated_camera(context: bpy.types.Context) -> str:
    if any(view.camera is not None and view.is_calibrated for view in context.scene.kfmocap.views):
        return ""
    return "No view has a calibrated camera yet, which clicks need: use Import Calibration, or Calibrate"


def _suiting(armature: bpy.types.Object) -> str:
    """Return what makes the lengths of a body those of the performer."""
    from ...scene_io.body.part_meshes import is_of_skin

    return "; its Height can be changed" if is_of_skin(armature) else "; Fit Body suits the body to the performer"


class PlacingTool(Conditional):
    """The modal tool behind `PlaceJoints`. It keys the pose only on Enter, and passes events outside the footage to
    Blender."""

    conditions = (has_performer, on_whole_frame, _has_calibrated_camera)

    def act(self, context: bpy.types.Context) -> None:
        """Pose the body on the present marks of this frame, for scripts."""
        self._begin(context)
        try:
            self._placing.key()
        except Exception:
            self._placing.restore()
            raise

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
        self._asks_to_discard, self._name = False, self._placing.slot.name
        self._pointer = event.mouse_x, event.mouse_y
        self._shown_frame = self._placing.frame
        self._drawing = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.window.cursor_modal_set("CROSSHAIR")
        context.window_manager.modal_handler_add(self)
        look = self._look(context)
        if event.type == "LEFTMOUSE" and event.value == "PRESS" and look is not None and self._is_inside(look):
            self._press = self._pointer  # the toolbar's tool: the click that begins it marks the first joint
        self._show_status(context)
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
            self._show_status(context)
        return result

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender closes its file or itself."""
        self._cancelled(context)

    def _begin(self, context: bpy.types.Context) -> None:
        from ...editing.click_posing import Placing

        slot = active_performer.chosen(context)
        self._placing = Placing(context.scene, slot, active_performer.chosen_bones(context, slot.armature))

    def _handled(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self._placing.is_there() or context.scene != self._placing.scene:
            raise KeypointError("its armature left the scene while joints were placed", where=self._name)
        self._follow_frame(context)
        if event.type == "MOUSEMOVE":
            self._dragging(context)
            return {"RUNNING_MODAL" if self._press else "PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self._press:
            self._released(context)
        elif event.value == "PRESS":
            return self._pressed(context, event)
        elif event.type.startswith(_VIEW) or not self._is_over_3d_view(context):
            return {"PASS_THROUGH"}
        return {"RUNNING_MODAL"}

    def _pressed(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        kind, asked = event.type, self._asks_to_discard
        if kind in _ENTER:
            return self._confirmed(context)
        if kind == "ESC":
            return self._cancelled(context)
        if kind == "Z" and (event.ctrl or event.oskey):
            self._placing.redo() if event.shift else self._placing.undo()
            return {"RUNNING_MODAL"}
        only_looks = kind.startswith(_VIEW) or kind in _STEPS + _SIDEBARS or navigates(event)
        if only_looks or not self._is_over_3d_view(context):
            return {"PASS_THROUGH"}
        self._asks_to_discard = kind == "RIGHTMOUSE" and not asked
        if kind == "RIGHTMOUSE" and (asked or not self._placing.is_changed()):
            return self._cancelled(context)
        look = self._look(context)
        if look is not None and not self._is_away(context):
            self._pressed_in(look, context, event)
        return {"RUNNING_MODAL"}

    def _pressed_in(self, look: viewport.Look, context: bpy.types.Context, event: bpy.types.Event) -> None:
        """Handle a key or mouse button over the footage, on the frame of the marks."""
        kind = event.type
        box = box_under(self._placing, look, self._pointer)
        if kind == "LEFTMOUSE" and box is not None:
            self._placing.choose(box)
        elif kind == "LEFTMOUSE" and self._is_inside(look):
            self._press = self._pointer
        elif kind == "A":
            self._alternative(look, -1 if event.shift else 1)
        elif kind in ("PAGE_UP", "PAGE_DOWN"):
            self._look_on(context, -1 if kind == "PAGE_UP" else 1)
        elif kind == "TAB":
            self._ask_on(look.view.name, -1 if event.shift else 1)
        elif kind in ("X", "DEL", "F"):
            self._edited(look, flip=kind == "F")

    def _alternative(self, look: viewport.Look, step: int) -> None:
        """Show the likeliest of the poses that look alike, or the next one."""
        count = len(self._placing.alternatives)
        if count:
            self._placing.choose((self._placing.alternative + step) % count)
        elif any(view == look.view.name for view, _ in self._placing.marks):
            self._placing.ask_alternatives(look.view.name)

    def _is_over_3d_view(self, context: bpy.types.Context) -> bool:
        """Whether the mouse is over the main region of a 3D view; elsewhere the user works as usual."""
        under = viewport.area_under(context.window, *self._pointer)
        return under is not None and under[0].type == "VIEW_3D" and under[1].type == "WINDOW"

    def _is_away(self, context: bpy.types.Context) -> bool:
        """Whether the frame shown is not that of the marks."""
        return context.scene.frame_current != self._placing.frame

    def _follow_frame(self, context: bpy.types.Context) -> None:
        """Show the pose again once the user is back from another frame."""
        if context.scene.frame_current != self._shown_frame:
            self._shown_frame = context.scene.frame_current
            if not self._is_away(context):
                self._show_again(context)

    def _show_again(self, context: bpy.types.Context) -> None:
        # When the frame or camera changes, Blender evaluates the keys again.
        context.view_layer.update()
        self._placing.show()

    def _dragging(self, context: bpy.types.Context) -> None:
        if self._press is None:
            return
        moved = max(abs(a - b) for a, b in zip(self._pointer, self._press, strict=True))
        look = self._look(context)
        if look is None or (self._dragged is None and moved < _CLICK):
            return
        if self._dragged is None:
            self._dragged = handle_under(self._placing, look, self._press) or self._asked_in(look.view.name)
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
        landmark = handle_under(self._placing, look, self._pointer)
        if landmark is not None and flip:
            self._placing.flip(look.view.name, landmark)
        elif landmark is not None and (look.view.name, landmark) in self._placing.marks:
            self._placing.unmark(look.view.name, landmark)

    def _asked_in(self, view: str) -> str | None:
        """Return the joint that the next click will place."""
        missing = self._placing.missing(view)
        asked = self._asked.get(view)
        return asked if asked in missing else missing[0] if missing else None

    def _ask_on(self, view: str, step: int) -> None:
        missing = self._placing.missing(view)
        if missing:
            self._asked[view] = missing[(missing.index(self._asked_in(view)) + step) % len(missing)]

    def _look(self, context: bpy.types.Context) -> viewport.Look | None:
        look = viewport.look_under(context, *self._pointer)
        return look if look is not None and look.view.name in self._placing.views() else None

    def _place(self, look: viewport.Look, pointer: tuple[int, int]) -> tuple[float, float]:
        return look.place(pointer[0] - look.region.x, pointer[1] - look.region.y)

    def _is_inside(self, look: viewport.Look) -> bool:
        return self._placing.is_inside(look.view.name, self._place(look, self._pointer))

    def _look_through_one(self, context: bpy.types.Context) -> None:
        """If no 3D view looks through a camera, make the one from which the tool was called do so."""
        areas = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
        if not any(viewport.look_of(context.scene, a, a.regions[-1], a.spaces.active) for a in areas):
            self._look_on(context, 0)

    def _look_on(self, context: bpy.types.Context, step: int) -> None:
        usable = [i for i, slot in enumerate(context.scene.kfmocap.views) if slot.name in self._placing.views()]
        shown = context.scene.kfmocap.shown_view
        show_view(context, usable[(usable.index(shown) + step if shown in usable else 0) % len(usable)])
        self._show_again(context)

    def _show_status(self, context: bpy.types.Context) -> None:
        look = self._look(context)
        asked = self._asked_in(look.view.name) if look is not None else None
        hint = hint_at(self._placing, asked, away=self._is_away(context), discards=self._asks_to_discard)
        context.workspace.status_text_set(hint)
        viewport.redraw(context)

    def _draw(self) -> None:
        context = bpy.context
        look = viewport.look_of(context.scene, context.area, context.region, context.space_data)
        if look is None or look.view.name not in self._placing.views() or self._is_away(context):
            return
        taken = self._dragged or (None if self._press else handle_under(self._placing, look, self._pointer))
        draw(self._placing, look, self._pointer, asked=self._asked_in(look.view.name), taken=taken)

    def _confirmed(self, context: bpy.types.Context) -> set[str]:
        if not self._placing.marks:
            return self._cancelled(context)
        if self._is_away(context):
            context.scene.frame_set(self._placing.frame)
        self._placing.key()
        self._ended(context)
        count, off = len(self._placing.marks), 1000 * self._placing.fitted.misfit
        todo = _suiting(self._placing.slot.armature) if off > _ILL_SUITED and count >= _MANY else ""
        self.report({"INFO"}, f"Key pose on frame {self._placing.frame}: {count} marks, missed by {off:.0f} mm{todo}")
        if outside := outside_shot(context.scene, self._placing.frame):
            self.report({"WARNING"}, f"{outside}: the key pose counts for nothing in tracking")
        return {"FINISHED"}

    def _cancelled(self, context: bpy.types.Context) -> set[str]:
        if self._placing.is_there():
            shown = context.scene.frame_current
            if self._is_away(context):
                context.scene.frame_set(self._placing.frame)
            self._placing.restore()
            if shown != self._placing.frame:
                context.scene.frame_set(shown)
        self._ended(context)
        return {"CANCELLED"}

    def _ended(self, context: bpy.types.Context) -> None:
        bpy.types.SpaceView3D.draw_handler_remove(self._drawing, "WINDOW")
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        viewport.redraw(context)


class PlaceJoints(PlacingTool, bpy.types.Operator):
    """Pose the body by clicking joints in the footage, in one camera or several: it follows with every click. Two
    cameras give the place of a joint; with one its depth stays as in the pose that is shown. Enter keys the pose. With
    bones selected in pose mode, these alone are posed and keyed"""

    bl_idname = "kfmocap.place_joints"
    bl_label = "Place Joints"
    bl_options = {"UNDO"}


CLASSES = (PlaceJoints,)
