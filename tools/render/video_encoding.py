"""Video files from pictures. Needs the bpy module."""

from __future__ import annotations

from pathlib import Path

import bpy


def encode(pictures: list[Path], size: tuple[int, int], fps: float, target: Path) -> None:
    """Encode PNG pictures as an H.264 file with Blender's sequencer."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    strips = scene.sequence_editor_create().strips
    strip = strips.new_image("pictures", str(pictures[0]), channel=1, frame_start=1)
    for picture in pictures[1:]:
        strip.elements.append(picture.name)
    strip.frame_final_duration = len(pictures)
    scene.frame_start, scene.frame_end = 1, len(pictures)
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.fps, render.fps_base = round(fps), round(fps) / fps
    render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec = "MPEG4", "H264"
    render.ffmpeg.constant_rate_factor = "PERC_LOSSLESS"
    render.ffmpeg.ffmpeg_preset, render.ffmpeg.gopsize = "BEST", 30
    render.use_file_extension = False
    render.filepath = str(target)
    bpy.ops.render.render(animation=True)
