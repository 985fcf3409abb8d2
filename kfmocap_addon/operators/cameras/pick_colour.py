"""Pick Colour: one click on a ball in its video."""

import bpy

from ....core.errors import CalibrationError
from ...scene_io import capture_scene as captures
from ..conditions import Conditional
from ..reporting import reported
from .capture_views import has_videos

PICTURE = "Calibration Footage"
_HINT = "Click on the ball; Left and Right go through the video; Enter takes what is circled, Esc leaves it as it was"


class PickColour(Conditional, bpy.types.Operator):
    """Click on a ball in a frame of the selected camera's video: its colour is learned, and what is found with it is
    circled"""

    bl_idname = "kfmocap.pick_colour"
    bl_label = "Pick Colour"
    conditions = (has_videos,)

    slot: bpy.props.EnumProperty(items=captures.slot_items(), name="Ball", description="Whose colour it is")
    frame: bpy.props.IntProperty(min=0, name="Frame", description="Frame of the video, from 0")
    point: bpy.props.IntVectorProperty(
        size=2,
        default=(-1, -1),
        name="Point",
        description="Where on the picture to click, pixels from its upper left corner",
    )

    def act(self, context: bpy.types.Context) -> None:
        self._open(context)
        self._learn(tuple(self.point))

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.area is None:
            return self.execute(context)
        with reported(self) as outcome:
            self._open(context)
        if outcome.value != {"FINISHED"}:
            return outcome.value
        self._area, self._was = context.area, context.area.type
        self._area.type = "IMAGE_EDITOR"
        self._area.spaces.active.image = bpy.data.images[PICTURE]
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set(_HINT)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.value == "PRESS" and event.type in ("ESC", "RIGHTMOUSE"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.value == "PRESS" and event.type in ("RET", "NUMPAD_ENTER"):
            self._close(context)
            return {"FINISHED"}
        if event.value == "PRESS" and event.type in ("LEFT_ARROW", "RIGHT_ARROW"):
            self.frame = max(0, self.frame + (1 if event.type == "RIGHT_ARROW" else -1) * self._step)
            with reported(self):
                self._show_frame()
            return {"RUNNING_MODAL"}
        if event.value == "PRESS" and event.type == "LEFTMOUSE":
            point = self._pixel(event)
            if point is not None:
                self.point = point
                with reported(self):
                    self._learn(point)
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Leave the colour as it was; also called when Blender closes its file or quits."""
        self._colour.put(self._before[0], self._before[1])
        self._close(context)

    def _open(self, context: bpy.types.Context) -> None:
        from ....core.shot.footage import probe

        capture = context.scene.kfmocap_capture
        take = "lframe" if self.slot == "lframe" else "wand"
        self._path = captures.video_of(capture.views[capture.active], take)
        self._colour = capture.colour(self.slot)
        self._before = self._colour.get(), tuple(self._colour.swatch)
        self._step = max(1, round(probe(self._path).fps / 2))
        self._show_frame()

    def _show_frame(self) -> None:
        from ....core.shot.footage import picture

        self._picture = picture(self._path, self.frame)
        self._show_found()

    def _learn(self, point: tuple[int, int]) -> None:
        from ....core.capture.colours import learned

        height, width = self._picture.shape[:2]
        if not (0 <= point[0] < width and 0 <= point[1] < height):
            raise CalibrationError(f"{point} is outside the picture", where=str(self._path))
        colour = learned(self._picture, point)
        blue, green, red = self._picture[point[1], point[0]] / 255
        self._colour.put(colour, (red, green, blue))
        self.report({"INFO"}, f"{self._show_found()} balls of this colour are found here")

    def _show_found(self) -> int:
        """Show the frame with circles around the balls found; returns their number."""
        from ....core.calibration.balls.ball_detection import Picture, find_balls, marked
        from ...scene_io import solved_cameras

        shown, count = self._picture, 0
        if captures.is_picked(self._colour):
            balls = find_balls(Picture.of(self._picture), self._colour.get())
            shown, count = marked(self._picture, balls), len(balls)
        solved_cameras.show_picture(PICTURE, shown)
        return count

    def _pixel(self, event: bpy.types.Event) -> tuple[int, int] | None:
        """Return the picture's pixel under the mouse, counted from its upper left."""
        region = next((r for r in self._area.regions if r.type == "WINDOW"), None)
        if region is None:
            return None
        x, y = region.view2d.region_to_view(event.mouse_x - region.x, event.mouse_y - region.y)
        height, width = self._picture.shape[:2]
        inside = 0 <= x < 1 and 0 <= y < 1
        return (int(x * width), height - 1 - int(y * height)) if inside else None

    def _close(self, context: bpy.types.Context) -> None:
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        self._area.type = self._was


CLASSES = (PickColour,)
