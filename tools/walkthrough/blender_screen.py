"""Operates Blender's window as a user would: finds labels, clicks on them, types, and takes screenshots.

Runs inside Blender under an X server; needs xdotool and ImageMagick. Every action is a generator that yields how
many seconds to wait before it continues.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import blf
import bpy
import gpu
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

Waits = Iterator[float]
Place = tuple[int, int]
"""Pixel of the screen, counted from its upper left corner."""
Box = tuple[int, int, int, int]
"""Left, top, right, bottom."""

_ALIKE = 0.8
"""Minimum correlation of a label with the screen: a label that is there exceeds it on any background."""


WORK_SECONDS = 7200.0
"""How long work may take that is slow on a busy machine: `tools/tutorial.py --seconds` ends the whole run earlier."""


class NotShownError(RuntimeError):
    """A label is not on the screen."""


def run(steps: Waits, picture: Path) -> None:
    """Carry out the steps, then quit Blender; a failing step saves a screenshot and ends Blender with exit code 1."""

    def tick() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            bpy.ops.wm.quit_blender()
        except Exception:
            traceback.print_exc()
            _photograph_to(picture)
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(1)
        return None

    bpy.app.timers.register(tick, first_interval=1.5, persistent=True)


def click(label: str, **where: Any) -> Waits:
    """Click on a label; the other arguments are those of `find`."""
    yield from click_at(find(label, **where))


def click_at(place: Place, button: int = 1) -> Waits:
    """Move the mouse to a place and click."""
    yield from hover(place)
    _xdotool("click", button)
    yield from settled()


def hover(place: Place) -> Waits:
    """Move the mouse to a place."""
    _xdotool("mousemove", *place)
    yield 0.3


def click_with(key: str, place: Place) -> Waits:
    """Click with a key held, such as "ctrl"."""
    yield from hover(place)
    _xdotool("keydown", key)
    yield 0.1
    _xdotool("click", 1)
    yield 0.2
    _xdotool("keyup", key)
    yield from settled()


def click_quickly(place: Place) -> Waits:
    """Click without waiting for the screen to come to rest."""
    yield from hover(place)
    _xdotool("click", 1)
    yield 0.3


def press(key: str, place: Place | None = None) -> Waits:
    """Press a key, such as "Return" or "ctrl+a", with the mouse at a place or where it is."""
    if place is not None:
        yield from hover(place)
    _xdotool("key", key)
    yield from settled()


def write(text: str, place: Place) -> Waits:
    """Replace the text of the field at a place, then press Return."""
    yield from click_at(place)
    yield from press("ctrl+a")
    _xdotool("type", "--delay", 15, text)
    yield from settled()
    yield from press("Return")


def choose_file(path: Path | str, button: str) -> Waits:
    """Enter a path in Blender's full-screen file browser and click on the button that accepts it."""
    height, width = screenshot().shape[:2]
    yield from write(str(path), (width // 2, 47))
    yield from click_at((width // 2, height - 8))  # leave the field, which would otherwise swallow the next click
    yield from click(button, within=(width // 2, height - 60, width, height))


def settled(seconds: float = 5.0) -> Waits:
    """Wait until the screen stops changing, for a limited number of seconds."""
    yield 0.6
    end, shown = time.monotonic() + seconds, screenshot()
    while time.monotonic() < end:
        yield 0.4
        before, shown = shown, screenshot()
        if before.shape == shown.shape and (before == shown).all():
            return


def until(condition: Callable[[], object], seconds: float = 120.0) -> Waits:
    """Wait for a condition.

    Raises
    ------
    TimeoutError
        If it is not met in time.
    """
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {seconds:.0f} s")
        yield 0.2


def find(label: str, *, within: Box | None = None, sideways: bool = False) -> Place:
    """Find the centre of a label on the screen, where it correlates best.

    Parameters
    ----------
    sideways : bool
        The label reads downwards, as on a tab.
    within : tuple, optional
        Where to look; by default everywhere.

    Raises
    ------
    NotShownError
        If it is not there.
    """
    screen, text = screenshot().max(axis=2).astype(float), _drawn(label)
    if sideways:
        text = np.rot90(text, -1)
    alike = _correlation(screen, text)
    h, w = text.shape
    if within is not None:
        left, top, right, bottom = within
        inside = np.zeros_like(alike, bool)
        inside[top:bottom, left:right] = True
        alike = np.where(inside, alike, 0.0)
    if alike.max() < _ALIKE:
        raise NotShownError(f"'{label}' is nowhere on the screen")
    row, column = (int(index) for index in np.unravel_index(np.argmax(alike), alike.shape))
    return column + w // 2, row + h // 2


def is_shown(label: str, **where: Any) -> bool:
    """Whether a label is on the screen; the other arguments are those of `find`."""
    try:
        find(label, **where)
    except NotShownError:
        return False
    return True


def screenshot() -> NDArray[np.uint8]:
    """Capture the screen, shape (h, w, 3)."""
    command = ["import", "-window", "root", "-depth", "8", "ppm:-"]
    picture = subprocess.run(command, capture_output=True, check=True).stdout
    _, size, _, pixels = picture.split(b"\n", 3)
    width, height = map(int, size.split())
    return np.frombuffer(pixels, np.uint8).reshape(height, width, 3)


def _photograph_to(path: Path) -> None:
    subprocess.run(["import", "-window", "root", str(path)], check=False)


def photograph(path: Path) -> Waits:
    """Save a screenshot, once the screen has come to rest."""
    yield from settled()
    _photograph_to(path)


def _xdotool(*arguments: object) -> None:
    subprocess.run(["xdotool", *map(str, arguments)], check=True)


def _drawn(label: str) -> NDArray[np.floating]:
    """Draw a label as Blender does, white on black, trimmed, shape (h, w)."""
    size = bpy.context.preferences.ui_styles[0].widget.points * bpy.context.preferences.system.ui_scale
    blf.size(0, size)
    width, height = int(blf.dimensions(0, label)[0]) + 6, int(1.6 * size)
    canvas = gpu.types.GPUOffScreen(width, height)
    with canvas.bind():
        frame = gpu.state.active_framebuffer_get()
        frame.clear(color=(0.0, 0.0, 0.0, 1.0))
        with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            gpu.matrix.load_matrix(Matrix.Identity(4))
            gpu.matrix.load_projection_matrix(
                Matrix(((2 / width, 0, 0, -1), (0, 2 / height, 0, -1), (0, 0, 1, 0), (0, 0, 0, 1)))
            )
            blf.color(0, 1, 1, 1, 1)
            blf.position(0, 3, round(0.45 * size), 0)
            blf.draw(0, label)
        pixels = frame.read_color(0, 0, width, height, 4, 0, "UBYTE")
    canvas.free()
    pixels.dimensions = width * height * 4
    return np.array(pixels, np.uint8).reshape(height, width, 4)[::-1, :, :3].max(axis=2).astype(float)


def _correlation(screen: NDArray[np.floating], text: NDArray[np.floating]) -> NDArray[np.floating]:
    """Normalised correlation for every position of a text's upper left corner."""
    h, w = text.shape
    pattern = text - text.mean()
    spectrum = np.fft.rfft2(screen) * np.conj(np.fft.rfft2(pattern, screen.shape))
    product = np.fft.irfft2(spectrum, screen.shape)[: screen.shape[0] - h + 1, : screen.shape[1] - w + 1]

    def summed(image: NDArray[np.floating]) -> NDArray[np.floating]:
        total = np.pad(image.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        return total[h:, w:] - total[:-h, w:] - total[h:, :-w] + total[:-h, :-w]

    variance = np.maximum(summed(screen**2) - summed(screen) ** 2 / (h * w), 1.0)
    return product / np.sqrt(variance * (pattern**2).sum())


def expect(held: object, claim: str) -> None:
    """See that something is so.

    Raises
    ------
    AssertionError
        It is not.
    """
    if not held:
        raise AssertionError(claim)
    print("seen:", claim, flush=True)
