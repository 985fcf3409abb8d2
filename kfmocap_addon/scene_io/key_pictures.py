"""Small pictures of key poses over the footage, for panels; the session keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import bpy.utils.previews

_NAME = "{performer} {frame}"


class KeyPictures:
    """Pictures by performer and frame, as icons of Blender's."""

    def __init__(self) -> None:
        self._icons: Any = None
        self._shown: dict[int, list[int]] = {}  # frames by the armature's number in this session

    def put(self, armature: bpy.types.Object, pictures: Mapping[int, Any]) -> None:
        """Show other pictures of a performer.

        Parameters
        ----------
        pictures : mapping of int to ndarray of uint8, shape (h, w, 3)
            By scene frame; blue, green, red.
        """
        import numpy as np

        if self._icons is None:
            self._icons = bpy.utils.previews.new()
        for frame, picture in pictures.items():
            name = _NAME.format(performer=armature.session_uid, frame=frame)
            icon = self._icons.get(name) or self._icons.new(name)
            pixels = np.ones((*picture.shape[:2], 4), np.float32)
            pixels[..., :3] = picture[::-1, :, ::-1] / 255.0  # Blender's begin below, with red
            icon.image_size = (picture.shape[1], picture.shape[0])
            icon.image_pixels_float.foreach_set(pixels.ravel())
            icon.icon_size = icon.image_size
            icon.icon_pixels_float.foreach_set(pixels.ravel())
        self._shown[armature.session_uid] = sorted(pictures)

    def icons(self, armature: bpy.types.Object) -> dict[int, int]:
        """Return the numbers of the icons of a performer, by scene frame."""
        frames = self._shown.get(armature.session_uid, [])
        names = {frame: _NAME.format(performer=armature.session_uid, frame=frame) for frame in frames}
        return {frame: self._icons[name].icon_id for frame, name in names.items()}

    def clear(self) -> None:
        """Forget all pictures."""
        if self._icons is not None:
            bpy.utils.previews.remove(self._icons)
        self._icons = None
        self._shown.clear()
