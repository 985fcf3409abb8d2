"""Interlaced footage: every field shows its instant, with its lines where they lie in the frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import FootageError
from kfmocap.core.shot import footage
from kfmocap.core.shot.footage import Album, frames_at
from kfmocap.core.shot.footage_faults.footage_checks import check_view
from kfmocap.core.shot.frame_numbers import file_index
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import View
from kfmocap.core.tracking.tracker import track
from synthetic import figure, film, look_at, pixel_grid, shot_of, swing
from test_footage import turn

Array = np.ndarray

SIZE = (192, 144)
LENS = (-0.2, 0.06, 0.002, -0.003)
COUNT = 8
ORDERS = ("top-first", "bottom-first")
OTHER = dict(zip(ORDERS, ORDERS[::-1], strict=True))
SPEED = np.array([1.1, 1.7])  # pixels per field

orders = pytest.mark.parametrize("order", ORDERS)


def camera(size: tuple[int, int] = SIZE, distortions: tuple[float, ...] = (0, 0, 0, 0)) -> Camera:
    K = [[200, 0, (size[0] - 1) / 2], [0, 200, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera.create("cam01", size, K, np.eye(3), np.zeros(3), distortions=distortions)


def pattern(shift: Array, size: tuple[int, int] = SIZE) -> Array:
    """Waves some 15 to 60 pixels long that have moved by a shift; uint8, shape (h, w)."""
    rng = np.random.default_rng(0)
    lengths, turns, phases = rng.uniform(15, 60, 12), rng.uniform(0, np.pi, 12), rng.uniform(0, 2 * np.pi, 12)
    waves = 2 * np.pi / lengths * np.stack([np.cos(turns), np.sin(turns)])
    grey = 127 + 14 * np.sin((pixel_grid(size) - shift) @ waves + phases).sum(axis=1)
    return np.clip(grey, 0, 255).round().astype(np.uint8).reshape(size[1], size[0])


def woven(instants: Sequence[Array], order: str) -> list[Array]:
    """Frames whose lines were taken in turn at two instants each."""
    frames = []
    for earlier, later in zip(instants[::2], instants[1::2], strict=True):
        top, bottom = (earlier, later) if order == "top-first" else (later, earlier)
        frames.append(top.copy())
        frames[-1][1::2] = bottom[1::2]
    return frames


def filed(folder: Path, images: Sequence[Array]) -> Path:
    folder.mkdir(parents=True)
    for i, image in enumerate(images):
        assert cv2.imwrite(str(folder / f"{i:03d}.png"), image)
    return folder / "%03d.png"


def filmed(folder: Path, instants: Sequence[Array], order: str, cam: Camera) -> tuple[View, View]:
    """The same instants as interlaced footage, and as progressive footage of twice the rate."""
    interlaced = View(cam, filed(folder / "woven", woven(instants, order)), fields=order)
    return interlaced, View(cam, filed(folder / "whole", instants))


def streamed(view: View, factor: float = 1, count: int = COUNT) -> Array:
    return np.stack([image.astype(float) for image in frames_at(view, range(count), factor)])


def displacement(before: Array, after: Array, border: int = 4) -> Array:
    """How far a picture has moved (u, v), pixels: least squares of the gradient constraint."""
    grey = (before + after) / 2
    inner = (slice(border, -border),) * 2
    along_v, along_u = (g[inner].ravel() for g in np.gradient(grey))
    changed = (after - before)[inner].ravel()
    return -np.linalg.lstsq(np.stack([along_u, along_v], axis=1), changed, rcond=None)[0]


@pytest.mark.parametrize(  # every factor, and every order with and without distortion
    ("order", "factor", "distortions"),
    [
        ("top-first", 1, (0, 0, 0, 0)),
        ("bottom-first", 1.5, LENS),
        ("top-first", 2, LENS),
        ("bottom-first", 3.3, (0, 0, 0, 0)),
        ("top-first", 4, LENS),
    ],
)
def test_a_scene_at_rest_neither_jumps_nor_flickers_from_field_to_field(
    tmp_path: Path, order: str, factor: float, distortions: tuple[float, ...]
) -> None:
    interlaced, whole = filmed(tmp_path, [pattern(np.zeros(2))] * 2, order, camera(distortions=distortions))
    (first, second), truth = streamed(interlaced, factor, 2), streamed(whole, factor, 1)[0]
    assert np.abs(displacement(first, second)).max() < 0.02
    assert np.abs(displacement(first, truth)).max() < 0.02
    assert (second - first)[4:-4].std() < 0.02 * truth.std()


@pytest.mark.parametrize(  # the factors of the test before with the other order
    ("order", "factor"),
    [("bottom-first", 1), ("top-first", 1.5), ("bottom-first", 2), ("top-first", 3.3), ("bottom-first", 4)],
)
def test_every_field_shows_its_instant(tmp_path: Path, order: str, factor: float) -> None:
    instants = [pattern(k * SPEED) for k in range(COUNT)]
    interlaced, whole = filmed(tmp_path, instants, order, camera(distortions=LENS))
    truth = streamed(whole, factor)
    for seen, true in zip(streamed(interlaced, factor), truth, strict=True):
        assert np.abs(displacement(true, seen)).max() < 0.03
        assert (seen - true)[4:-4].std() < 0.1 * true.std()
    swapped = streamed(replace(interlaced, fields=OTHER[order]), factor)
    for k, (seen, true) in enumerate(zip(swapped, truth, strict=True)):
        ahead = SPEED if k % 2 == 0 else -SPEED
        np.testing.assert_allclose(factor * displacement(true, seen), ahead, rtol=0.35)


@orders
def test_a_field_lies_where_its_camera_projects(tmp_path: Path, order: str) -> None:
    """A bright spot in the lines of a field alone, at the height that the field's camera tells."""
    cam, points = camera(distortions=LENS), np.array([[0.2, -0.1, 1.0], [-0.25, 0.2, 1.0]])
    spots = []
    for point in points:
        d2 = ((pixel_grid(SIZE) - cam.project(point)) ** 2).sum(axis=1)
        spots.append((255 * np.exp(-d2 / 18)).round().astype(np.uint8).reshape(SIZE[1], SIZE[0]))
    [frame] = woven(spots, order)
    interlaced = View(cam, filed(tmp_path / "spots", [frame]), fields=order)
    for k, (point, seen) in enumerate(zip(points, streamed(interlaced, 1, 2), strict=True)):
        parity = k if order == "top-first" else 1 - k
        np.testing.assert_allclose(centroid(frame[parity::2]), cam.field(parity).project(point), atol=0.02)
        # A lens of some percent spreads the spot unevenly.
        np.testing.assert_allclose(centroid(seen), cam.rectified().project(point), atol=0.08)


def centroid(image: Array) -> Array:
    v, u = np.indices(image.shape)
    weight = np.where(image > 1, image, 0).astype(float)
    return np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()


@orders
def test_footage_of_odd_height_has_fields_of_unequal_height(tmp_path: Path, order: str) -> None:
    size = (96, 71)
    instants = [pattern(k * SPEED, size) for k in range(4)]
    interlaced, whole = filmed(tmp_path, instants, order, camera(size))
    for seen, true in zip(streamed(interlaced, 1, 4), streamed(whole, 1, 4), strict=True):
        assert np.abs(displacement(true, seen)).max() < 0.03


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_fields_are_the_lines_as_stored_however_the_footage_is_turned(tmp_path: Path, degrees: int) -> None:
    instants = [pattern(k * SPEED) for k in range(4)]
    path = lossless(tmp_path / "woven.mov", woven(instants, "top-first"))
    turn(path, degrees)
    expected = [np.rot90(instant, -degrees // 90) for instant in instants]
    view = View(camera(expected[0].shape[::-1]), path, fields="top-first")
    for seen, true in zip(streamed(view, 1, 4), expected, strict=True):
        assert seen.shape == true.shape
        assert np.abs(displacement(true.astype(float), seen)).max() < 0.03


def lossless(path: Path, frames: Sequence[Array]) -> Path:
    """A video that keeps every grey level."""
    height, width = frames[0].shape
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"png "), 25, (width, height))
    for frame in frames:
        video.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    video.release()
    return path


def levels(fields: int = COUNT) -> list[Array]:
    """Flat instants that tell their number: 10, 40, 70 ..."""
    return [np.full(SIZE[::-1], 10 + 30 * k, np.uint8) for k in range(fields)]


def numbers(images: Sequence[Array]) -> list[int]:
    return [round((float(image.mean()) - 10) / 30) for image in images]


@orders
@pytest.mark.parametrize(
    ("offset", "fields"), [(0.0, [1, 2, 5]), (1.0, [2, 3, 6]), (-0.6, [0, 1, 4]), (0.6, [2, 3, 6])]
)
def test_offsets_count_fields(tmp_path: Path, order: str, offset: float, fields: list[int]) -> None:
    path = lossless(tmp_path / "woven.mov", woven(levels(), order))
    view = View(camera(), path, offset, order)
    assert numbers(frames_at(view, [1, 2, 5], 2)) == fields
    assert [file_index(view, frame) for frame in (1, 2, 5)] == [field // 2 for field in fields]


@orders
def test_pictures_kept_on_the_way_are_of_the_field_as_well(tmp_path: Path, order: str) -> None:
    view = View(camera(), filed(tmp_path / "woven", woven(levels(), order)), fields=order)
    album = Album(frozenset({2, 5}), 1.0)
    assert numbers(frames_at(view, range(COUNT), 3, album=album)) == list(range(COUNT))
    assert {frame: picture.shape for frame, picture in album.pictures.items()} == dict.fromkeys((2, 5), (144, 192, 3))
    assert numbers(list(album.pictures.values())) == [2, 5]


def test_a_frame_is_decoded_once_for_its_two_fields(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[int] = []

    class Counting:
        def __init__(self, *arguments: object) -> None:
            self.video = VideoCapture(*arguments)

        def __getattr__(self, name: str) -> object:
            if name in ("read", "grab"):
                decoded.append(1)
            return getattr(self.video, name)

    VideoCapture = cv2.VideoCapture
    view = View(camera(), lossless(tmp_path / "woven.mov", woven(levels(), "top-first")), fields="top-first")
    monkeypatch.setattr(footage.cv2, "VideoCapture", Counting)
    assert numbers(frames_at(view, range(1, COUNT), 1)) == list(range(1, COUNT))
    assert len(decoded) == COUNT // 2


@pytest.mark.parametrize("suffix", ["video", "images"])
@pytest.mark.parametrize(
    ("length", "offset", "message"),
    [
        (COUNT + 1, 0, "only 8 fields, 0 to 7: with offset 0 the shot's 9 frames are its fields 0 to 8"),
        (COUNT, 1, "only 8 fields, .* with offset 1 .* are its fields 1 to 8"),
        (2, -1, "begins before the footage: .* are its fields -1 to 0"),
    ],
)
def test_the_range_is_checked_in_fields(tmp_path: Path, suffix: str, length: int, offset: float, message: str) -> None:
    frames = woven(levels(), "top-first")
    path = lossless(tmp_path / "woven.mov", frames) if suffix == "video" else filed(tmp_path / "woven", frames)
    view = View(camera(), path, offset, "top-first")
    with pytest.raises(FootageError, match=rf"woven.*cam01.*{message}"):
        check_view(view, 0, length)
    assert check_view(replace(view, offset=0.0), 0, COUNT).count == COUNT // 2


def test_the_size_is_that_of_whole_frames(tmp_path: Path) -> None:
    path = filed(tmp_path / "woven", woven(levels(), "top-first"))
    with pytest.raises(FootageError, match="192x144, the calibration of 'cam01' 192x72"):
        check_view(View(camera((192, 72)), path, fields="top-first"), 0, 4)


LENGTH = 12
BODY = figure()
TRUTH = swing(BODY, LENGTH)
EYES = (
    look_at("front", (0.5, -2.8, 1.5), size=(240, 180), focal=285),
    look_at("side", (-2.4, -1.4, 1.3), size=(240, 180), focal=285),
)


def error_mm(views: Sequence[View]) -> float:
    """Mean distance of the landmarks of the motion that is tracked between its two ends."""
    found = track(shot_of(views, [BODY], [TRUTH], (0, LENGTH - 1), Settings(limb_search=False))).motions[0]
    return 1000 * np.linalg.norm(places(found) - places(TRUTH), axis=-1).mean()


def places(motion: Motion) -> Array:
    return landmark_positions(BODY, motion, list(BODY.landmarks))


@pytest.fixture(scope="module")
def progressive(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], EYES)


@pytest.fixture(scope="module")
def whole(progressive: list[View]) -> float:
    """The error where whole frames are tracked."""
    return error_mm(progressive)


def interlaced(view: View, folder: Path, order: str) -> View:
    instants = [cv2.imread(str(view.footage.parent / f"{f:03d}.png"), cv2.IMREAD_GRAYSCALE) for f in range(LENGTH)]
    return replace(view, footage=filed(folder / view.camera.name, woven(instants, order)), fields=order)


@orders
def test_fields_are_tracked_nearly_as_well_as_whole_frames(
    tmp_path: Path, progressive: list[View], whole: float, order: str
) -> None:
    """Half of the lines cost less than a millimetre."""
    fields = [interlaced(view, tmp_path, order) for view in progressive]
    assert whole < 1.9
    assert error_mm(fields) < whole + 0.9
    assert error_mm([fields[0], progressive[1]]) < whole + 0.9
    assert error_mm([replace(view, fields=OTHER[order]) for view in fields]) > 20 * whole
