"""Footage: what is streamed are the right frames, the right way up, at the right size."""

from __future__ import annotations

import os
import shutil
import struct
import sys
import time
import unicodedata
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import FootageError
from kfmocap.core.shot.footage import Footage, decodable, frames_at, pictures, probe
from kfmocap.core.shot.footage_faults.footage_checks import check_rates, check_view
from kfmocap.core.shot.footage_files import image_sequences, image_sizes
from kfmocap.core.shot.footage_files.image_sequences import footage_of, named_footage
from kfmocap.core.shot.footage_files.video_edits import shown_share
from kfmocap.core.shot.frame_numbers import footage_index
from kfmocap.core.shot.shot import View

SIZE = (64, 48)
COUNT = 12
HEIC = struct.pack(">I4s4sI4sI4s", 20, b"ftyp", b"heic", 0, b"mif1", 300, b"meta") + bytes(292)
"""A photo as telephones take it: what is in it is described in another box than that of a film."""
# The matrices of an MP4's track header: how a player is to turn the frames, clockwise.
TURNS = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}


def grey_of(frame: int) -> int:
    return 20 + 18 * frame


def picture(frame: int) -> np.ndarray:
    """A flat grey that tells the frame, with a white corner that tells what is up."""
    image = np.full((SIZE[1], SIZE[0], 3), grey_of(frame), np.uint8)
    image[: SIZE[1] // 4, : SIZE[0] // 4] = 255
    return image


def write_video(path: Path, count: int = COUNT, fps: float = 30) -> Path:
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, SIZE)
    for frame in range(count):
        video.write(picture(frame))
    video.release()
    return path


def turn(path: Path, degrees: int) -> None:
    data = bytearray(path.read_bytes())
    header = data.index(b"tkhd") + 4
    at = header + 4 + (20 if data[header] == 0 else 32) + 16
    a, b, c, d = (65536 * x for x in TURNS[degrees])
    data[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


def camera(size: tuple[int, int] = SIZE, distortions: tuple[float, ...] = (0, 0, 0, 0)) -> Camera:
    K = [[60, 0, (size[0] - 1) / 2], [0, 60, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera.create("cam01", size, K, np.eye(3), np.zeros(3), distortions=distortions)


def frame_of(image: np.ndarray) -> int:
    return round((float(np.median(image)) - 20) / 18)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("footage") / "clip.mp4")


@pytest.mark.parametrize(("every", "offset"), [(2, 0.0), (2, 3.0), (3, -1.4)])
def test_of_footage_with_several_frames_for_each_of_the_shot_one_is_streamed(
    video: Path, every: int, offset: float
) -> None:
    view = View(camera(), video, offset, every=every)
    frames = range(1, 4)
    assert [frame_of(image) for image in frames_at(view, frames, 1)] == [every * f + round(offset) for f in frames]
    with pytest.raises(FootageError, match=rf"only 12 frames, .* and every = {every} the shot's 7 frames are its"):
        check_view(view, 0 if offset >= 0 else 1, 7)


@pytest.mark.parametrize(
    ("rates", "said"),
    [
        ((30, 29.97, 0), None),
        (
            (30, 60, 0),
            r"fast \(camera 'cam2'\): it has 60 frames .* 'cam1' 30 \(write every = 2 in .* 30 as the shot's",
        ),
        ((119.88, 30, 30), r"fast \(camera 'cam1'\): it has 119.88 frames .*\(write every = 4"),
        (
            (25, 30, 25),
            r"it has 30 frames .* 'cam1' 25 \(convert it, as with: ffmpeg -i FOOTAGE -vf fps=25 .*every = 1",
        ),
        ((0, 0, 50), None),
    ],
)
def test_views_with_other_frame_rates_are_refused_with_what_to_write(
    rates: tuple[float, ...], said: str | None
) -> None:
    views, footages = [], []
    for number, rate in enumerate(rates, 1):
        path = Path("fast" if rate == max(rates) else "slow")
        views.append(View(replace(camera(), name=f"cam{number}"), path))
        footages.append(Footage(path, SIZE, COUNT, rate))
    if said is None:
        check_rates(views, footages, 30)
    else:
        with pytest.raises(FootageError, match=said):
            check_rates(views, footages, 30)


def test_fields_count_as_frames_where_rates_are_compared() -> None:
    views = [View(camera(), Path("a"), fields="top-first"), View(replace(camera(), name="cam02"), Path("b"))]
    check_rates(views, [Footage(Path("a"), SIZE, COUNT, 25), Footage(Path("b"), SIZE, COUNT, 50)], 50)


def test_frames_come_in_order_from_the_asked_one(video: Path) -> None:
    assert [frame_of(image) for image in frames_at(View(camera(), video), range(3, 9), 1)] == [
        3,
        4,
        5,
        6,
        7,
        8,
    ]


def test_any_increasing_frames_can_be_had(video: Path) -> None:
    assert [frame_of(image) for image in frames_at(View(camera(), video), [0, 5, 6, 11], 1)] == [0, 5, 6, 11]


@pytest.mark.parametrize(("offset", "index"), [(0.0, 4), (2.0, 6), (-1.0, 3), (0.4, 4), (0.6, 5), (-0.4, 4)])
def test_offset_leads_to_the_nearest_frame_of_the_footage(video: Path, offset: float, index: int) -> None:
    view = View(camera(), video, offset)
    assert footage_index(view, 4) == index
    assert frame_of(next(frames_at(view, [4], 1))) == index


@pytest.mark.parametrize("degrees", TURNS)
def test_rotation_metadata_is_obeyed(tmp_path: Path, degrees: int) -> None:
    path = write_video(tmp_path / "turned.mp4")
    turn(path, degrees)
    expected = np.rot90(picture(2)[..., 0], -degrees // 90)
    size = expected.shape[::-1]
    assert probe(path).size == size
    for image in (next(frames_at(View(camera(size), path), [2], 1)), list(pictures(path))[2][..., 0]):
        assert image.shape == expected.shape
        assert np.abs(image.astype(int) - expected).mean() < 6


def test_footage_of_another_size_than_the_calibration_names_both(video: Path) -> None:
    with pytest.raises(FootageError, match=r"clip\.mp4.*64x48.*'cam01' 60x64.*rotation"):
        check_view(View(camera((60, 64)), video), 0, 4)
    with pytest.raises(FootageError, match=r"64x48.*'cam01' 48x64 \(.*as they are stored.*-display_rotation 0"):
        check_view(View(camera((48, 64)), video), 0, 4)


@pytest.mark.parametrize(
    ("first", "length", "offset", "message"),
    [
        (0, 13, 0, "only 12 frames"),
        (5, 8, 0.0, "only 12 frames"),
        (0, 12, 1, "1 to 12"),
        (0, 4, -1, "-1 to 2"),
    ],
)
def test_too_short_footage_names_the_numbers(video: Path, first: int, length: int, offset: float, message: str) -> None:
    with pytest.raises(FootageError, match=rf"clip\.mp4.*cam01.*{message}"):
        check_view(View(camera(), video, offset), first, length)


def test_missing_and_unreadable_footage_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FootageError, match="no such footage"):
        probe(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("this is no video")
    with pytest.raises(FootageError, match=r"text\.mp4.*cannot be read"):
        probe(tmp_path / "text.mp4")


def test_what_was_not_fetched_and_what_leads_nowhere_is_called_so(tmp_path: Path) -> None:
    (tmp_path / "lfs.mp4").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    (tmp_path / "gone.mp4").symlink_to("elsewhere.mp4")
    (tmp_path / "loop.mp4").symlink_to("loop.mp4")
    for name, words in (("lfs", "git lfs pull"), ("gone", "a link to 'elsewhere.mp4'"), ("loop", "back to itself")):
        with pytest.raises(FootageError, match=words):
            probe(tmp_path / f"{name}.mp4")


def test_a_video_that_was_cut_before_its_index_is_called_so(video: Path, tmp_path: Path) -> None:
    data, cut = video.read_bytes(), tmp_path / "cut.mp4"
    cut.write_bytes(data[: data.index(b"moov") - 4])
    with pytest.raises(FootageError, match=r"its index is missing.*copy the file from the camera again"):
        probe(cut)
    for other in (bytes(range(256)) * 9, HEIC):  # no video at all
        cut.write_bytes(other)
        with pytest.raises(FootageError, match=r"as a video \(convert it"):
            probe(cut)


@pytest.mark.parametrize("named", ["smb://nas/shoot/cam01.mp4", "https://example.org/cam01.mp4"])
def test_an_address_is_not_taken_for_a_misspelt_path(tmp_path: Path, named: str) -> None:
    with pytest.raises(FootageError, match="this is an address"):
        probe(tmp_path / named)


@pytest.mark.parametrize(
    ("named", "there", "meant"),
    [
        ("Take1.MP4", "take1.mp4", True),
        (unicodedata.normalize("NFC", "Käm1.mp4"), unicodedata.normalize("NFD", "Käm1.mp4"), True),
        ("cam_1.mp4", "cam1.mp4", True),
        ("take1.mp4", "take2.mp4", False),
    ],
)
def test_missing_footage_names_the_file_that_may_be_meant(tmp_path: Path, named: str, there: str, meant: bool) -> None:
    """As after copying from a system that does not tell capitals apart, or that writes accents otherwise."""
    (tmp_path / there).touch()
    with pytest.raises(FootageError) as caught:
        probe(tmp_path / named)
    assert (caught.value.todo == f"did you mean '{there}'?") is meant


def test_footage_that_breaks_off_names_the_frame(tmp_path: Path) -> None:
    for f in (0, 1, 3):
        cv2.imwrite(str(tmp_path / f"f{f}.png"), picture(f))
    with pytest.raises(FootageError, match="frame 2 is missing"):
        list(frames_at(View(camera(), tmp_path / "f#.png"), range(4), 1))


def test_frames_that_an_edit_list_cuts_off_are_not_counted(video: Path, tmp_path: Path) -> None:
    data = bytearray(video.read_bytes())
    place = data.index(b"elst") + 12  # of the length of its only edit
    (whole,) = struct.unpack(">I", data[place : place + 4])
    assert probe(video).count == COUNT
    data[place : place + 4] = struct.pack(">I", whole * 2 // 3)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(data)
    assert probe(cut).count == decodable(cut, COUNT) < COUNT
    for size in range(0, len(data), 97):  # of a damaged file, too
        cut.write_bytes(data[:size])
        assert 0 < shown_share(cut) <= 1


def test_a_cover_before_the_video_is_named(tmp_path: Path) -> None:
    path = tmp_path / "covered.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*"MJPG"), 30, SIZE)
    for frame in range(COUNT):
        writer.write(picture(frame))
    writer.release()
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"00dc", data.index(b"00dc") + 4)])
    with pytest.raises(FootageError, match=r"a cover before the video proper.* -map 0:v:1"):
        probe(path)


@pytest.mark.parametrize("pattern", ["img_%04d.png", "img_####.png", "img_*.png"])
def test_numbered_images_start_at_their_lowest_number(tmp_path: Path, pattern: str) -> None:
    for f in range(COUNT):
        cv2.imwrite(str(tmp_path / f"img_{f + 1001:04d}.png"), picture(f))
    (tmp_path / "img_notes.txt").touch()
    view = View(camera(), tmp_path / pattern)
    assert probe(view.footage).count == COUNT
    assert [frame_of(image) for image in frames_at(view, range(2, 5), 1)] == [2, 3, 4]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ([f"img_{f + 1001:04d}.png" for f in range(3)], "img_####.png"),
        (["8.png", "9.png", "10.png", "notes.txt", ".hidden1.png"], "#.png"),
        (["cam01 take2 0998.jpg", "cam01 take2 0999.jpg"], "cam01 take2 ####.jpg"),
        (["still.png"], "still.png"),
    ],
)
def test_a_folder_with_one_sequence_is_that_sequence(tmp_path: Path, names: list[str], found: str) -> None:
    for name in names:
        (tmp_path / name).touch()
    assert named_footage(tmp_path) == tmp_path / found
    assert len(image_sequences.image_files(tmp_path / found) or {}) == sum(
        n[0] != "." and "txt" not in n for n in names
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            ["a_1.png", "a_2.png", "b_1.png"],
            r"several image sequences: a_#\.png, b_#\.png .name one of them, as .*/a_#",
        ),
        (["a_1.png", "a_1.jpg"], r"several image sequences: a_#\.jpg, a_#\.png"),
        (["clip.mp4"], r"a folder, and has no images in it .name a video, or a pattern"),
        ([], r"a folder, and has no images in it"),
        (
            ["a_1.dpx", "a_2.dpx"],
            r"a_1\.dpx: DPX images cannot be read .*: ffmpeg -start_number 1 -i a_%01d\.dpx ",
        ),
    ],
)
def test_what_a_folder_holds_is_said(tmp_path: Path, names: list[str], message: str) -> None:
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(FootageError, match=message):
        probe(named_footage(tmp_path))
    with pytest.raises(FootageError, match="folder"):
        probe(tmp_path)


def test_a_pattern_that_no_image_fits_is_answered_with_those_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "a_1.PNG").touch()
    with pytest.raises(FootageError, match=r"a_#\.png: no image fits this pattern .in its folder are a_#\.PNG"):
        probe(tmp_path / "a_#.png")
    with pytest.raises(FootageError, match=r"no images in its folder"):
        probe(tmp_path / "none" / "a_#.png")


def test_globbed_images_are_taken_in_natural_order(tmp_path: Path) -> None:
    for f in range(COUNT):
        cv2.imwrite(str(tmp_path / f"shot{f}.png"), picture(f))
    images = frames_at(View(camera(), tmp_path / "shot*.png"), range(COUNT), 1)
    assert [frame_of(image) for image in images] == list(range(COUNT))


def test_images_of_differing_size_are_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a1.png"), picture(0))
    cv2.imwrite(str(tmp_path / "a2.png"), picture(1)[:-8])
    with pytest.raises(FootageError, match=r"a2\.png.*64x40, not 64x48"):
        list(frames_at(View(camera(), tmp_path / "a#.png"), range(2), 1))


@pytest.mark.parametrize("factor", [1, 2, 3.3])
def test_reduced_frames_fit_the_reduced_camera(tmp_path: Path, factor: float) -> None:
    """A bright disc lies where the camera, distortion taken away, projects its centre."""
    cam = camera(distortions=(-0.3, 0.1, 0.002, -0.001))
    ray = np.array([0.25, -0.15, 1.0])
    u, v = cam.project(ray)
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    image[...] = (255 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 5))[..., None]
    cv2.imwrite(str(tmp_path / "disc.png"), image)
    reduced = next(frames_at(View(cam, tmp_path / "disc.png"), [0], factor)).astype(float)
    expected = cam.rectified().reduced(factor).project(ray)
    assert reduced.shape[::-1] == cam.reduced(factor).size
    y, x = np.mgrid[: reduced.shape[0], : reduced.shape[1]]
    centre = np.array([(x * reduced).sum(), (y * reduced).sum()]) / reduced.sum()
    assert np.allclose(centre, expected, atol=0.12)


@pytest.fixture
def sequence(tmp_path: Path) -> View:
    """Twelve images, PNG and JPEG by turns."""
    for k in range(12):
        cv2.imwrite(str(tmp_path / f"f{k:02d}.{'jpg' if k % 2 else 'png'}"), picture(k))
    for k in range(12):
        (tmp_path / f"f{k:02d}.{'jpg' if k % 2 else 'png'}").rename(tmp_path / f"f{k:02d}.img")
    return View(camera(), tmp_path / "f%02d.img")


def test_a_whole_sequence_is_checked_without_decoding_it(sequence: View, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_sequences, "read_image", lambda path: pytest.fail(f"{path} was decoded"))
    check_view(sequence, 0, 12)


def test_gaps_in_a_sequence_are_found_before_it_is_used(sequence: View) -> None:
    for k in (3, 7, 8):
        (sequence.footage.parent / f"f{k:02d}.img").unlink()
    check_view(sequence, 0, 3)
    missing = (
        r"f%02d\.img: images are missing in the sequence: frames 3, 7-8, counted from 0, .* after f02\.img.* \*\.img"
    )
    with pytest.raises(FootageError, match=missing):
        check_view(sequence, 0, 12)


@pytest.mark.parametrize("frame", [4, 5])
def test_an_image_of_another_size_or_cut_off_is_found_before_the_sequence_is_used(sequence: View, frame: int) -> None:
    file = sequence.footage.parent / f"f{frame:02d}.img"
    whole = file.read_bytes()
    encoded = cv2.imencode(".jpg" if frame % 2 else ".png", np.zeros((20, 30, 3), np.uint8))[1]
    file.write_bytes(encoded.tobytes())
    with pytest.raises(FootageError, match=rf"f0{frame}\.img: the image is 30x20, not 64x48"):
        check_view(sequence, 0, 12)
    file.write_bytes(whole[:20])
    with pytest.raises(FootageError, match=rf"f0{frame}\.img: the image cannot be read"):
        check_view(sequence, 0, 12)


def test_images_that_opencv_does_not_read_are_named_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "f00.exr").write_bytes(b"\x76\x2f\x31\x01" + bytes(300))
    with pytest.raises(FootageError, match=r"f00\.exr: EXR images cannot be read .*convert .*png"):
        check_view(View(camera(), tmp_path / "f##.exr"), 0, 1)


@pytest.mark.parametrize(
    ("name", "inputs", "output"),
    [
        ("cam01.1001.exr", "ffmpeg -start_number 1001 -i cam01.%04d.exr ", " -start_number 1001 cam01.%04d.png"),
        ("still.EXR", "ffmpeg -i still.EXR ", " still.png"),
    ],
)
def test_the_command_that_converts_exr_images_names_them(tmp_path: Path, name: str, inputs: str, output: str) -> None:
    (tmp_path / name).write_bytes(b"\x76\x2f\x31\x01" + bytes(300))
    with pytest.raises(FootageError) as caught:
        image_sequences.read_image(tmp_path / name)
    assert caught.value.todo is not None
    assert inputs in caught.value.todo and caught.value.todo.endswith(output)


def test_a_codec_that_opencv_cannot_decode_is_named_before_tracking(video: Path, tmp_path: Path) -> None:
    """The container says AV1: it opens, and no frame of it comes."""
    path = tmp_path / "new.mp4"
    path.write_bytes(video.read_bytes().replace(b"mp4v", b"av01").replace(b"esds", b"free"))
    with pytest.raises(FootageError, match=r"new\.mp4: OpenCV cannot decode the footage \(codec AV01\) .*ffmpeg"):
        check_view(View(camera(), path), 0, 4)


@pytest.mark.parametrize(
    "name",
    ["f" * 5000, "f\0.png", "f%099999999999d.png", "f" + "#" * 30 + ".png", "*a" * 30 + "*b", "x" * 300 + ".mp4"],
)
def test_strange_names_of_footage_are_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / ("a" * 200)).touch()
    begun = time.perf_counter()
    with pytest.raises(FootageError):
        probe(tmp_path / name)
    assert time.perf_counter() - begun < 0.5


@pytest.mark.parametrize("ending", [".mp4", ".m3u8"])
@pytest.mark.parametrize(
    "text",
    [
        "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nnone.ts\n",
        "ffconcat version 1.0\nfile video.mp4\n",
        "v=0\no=- 0 0\n",
    ],
)
def test_a_playlist_is_refused_and_opens_no_other_file(video: Path, ending: str, text: str) -> None:
    """FFmpeg would read the video that it names, or wait half a minute for one that is not there."""
    path = video.with_name(f"list{ending}")
    path.write_text(text.replace("video.mp4", video.name))
    begun = time.perf_counter()
    with pytest.raises(FootageError, match=rf"list\{ending}: .* is a text, such as a playlist"):
        probe(path)
    assert time.perf_counter() - begun < 1


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (b"BLENDER-v405REND\0\0\0\0\x80\xff", "a Blender file"),
        (b"\x28\xb5\x2f\xfd\x04\0\xff", "a compressed Blender file"),
        (b"PK\3\4\x14\0\0\0", "a ZIP archive"),
        (b"RIFF\x24\0\0\0WAVEfmt ", "a sound recording"),
        (b"ID3\4\0\0\0\0\0\0", "a sound recording"),
    ],
)
def test_what_is_no_video_is_called_by_its_name(tmp_path: Path, data: bytes, kind: str) -> None:
    (tmp_path / "cam01.mp4").write_bytes(data)
    with pytest.raises(FootageError, match=f"cam01.mp4: this is {kind}, not a video"):
        probe(tmp_path / "cam01.mp4")


def test_a_recording_of_sound_alone_is_not_said_to_need_another_codec(video: Path) -> None:
    place = video.read_bytes().index(b"vide", video.read_bytes().index(b"hdlr"))
    data = bytearray(video.read_bytes())
    data[place : place + 4] = b"soun"
    video.write_bytes(data)
    with pytest.raises(FootageError, match=r"it has sound, but no pictures \(name"):
        probe(video)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "cam01.mp4")
    with pytest.raises(FootageError, match="pipe or a device"):
        probe(tmp_path / "cam01.mp4")


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names of files are texts there")
def test_a_video_with_an_undecodable_path_is_refused_where_opencv_would_crash(video: Path) -> None:
    folder = video.with_name(os.fsdecode(b"caf\xe9"))
    folder.mkdir()
    with pytest.raises(FootageError, match="not written in UTF-8"):
        probe(Path(shutil.copy(video, folder / video.name)))


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".tif", ".webp"])
def test_the_size_that_a_file_claims_is_that_of_its_image(ending: str) -> None:
    data = cv2.imencode(ending, np.zeros((30, 52, 3), np.uint8))[1].tobytes()
    assert image_sizes.image_size(data) == (52, 30)
    for end in range(60):
        assert image_sizes.image_size(data[:end]) in (None, (52, 30))
    assert image_sizes.image_size(b"P6 52 30 255\n" + data) is None


def test_a_small_file_that_claims_a_huge_image_is_refused_at_once(tmp_path: Path) -> None:
    """625 million pixels in 600 kB would take gigabytes."""
    whole = cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes()
    for name, size in (("a0.png", (64, 48)), ("a1.png", (25000, 25000))):
        head = b"IHDR" + struct.pack(">II", *size) + whole[24:29]
        (tmp_path / name).write_bytes(whole[:12] + head + struct.pack(">I", zlib.crc32(head)) + whole[33:])
    check_view(View(camera(), tmp_path / "a0.png"), 0, 1)
    with pytest.raises(FootageError, match=r"a1\.png: the image is too large for a file of \d+ bytes: 25000x25000"):
        probe(tmp_path / "a1.png")
    with pytest.raises(FootageError, match=r"a1\.png: the image is too large"):
        check_view(View(camera(), tmp_path / "a#.png"), 0, 2)


def test_a_png_that_claims_a_piece_longer_than_its_file_is_refused(tmp_path: Path) -> None:
    """OpenCV would make room for it: 2 kB took 600 MB."""
    whole = cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes()
    place = whole.index(b"IDAT") - 4
    for name, length in (("a0.png", whole[place : place + 4]), ("a1.png", b"\x27\0\0\0")):
        (tmp_path / name).write_bytes(whole[:place] + length + whole[place + 4 :] + b"what others put behind it")
    assert probe(tmp_path / "a0.png").size == (64, 48)
    with pytest.raises(FootageError, match=r"a1\.png: the image cannot be read"):
        probe(tmp_path / "a1.png")


@pytest.mark.parametrize(
    ("there", "chosen", "wanted"),
    [
        (["a95.png", "a99.png", "a100.png"], ["a95.png", "a99.png", "a100.png"], ["a##.png"]),
        (["a95.png", "a99.png", "a100.png"], ["a100.png"], ["a##.png"]),
        (["a1.png", "a0095.png", "a0100.png"], ["a0100.png"], ["a####.png"]),
        (["a099.png", "a100.png"], ["a100.png"], ["a###.png"]),
        (["a0099.png", "a9999.png", "a10000.png"], ["a0099.png", "a9999.png", "a10000.png"], ["a####.png"]),
        (["a8.png", "a9.png", "a10.png", "b10.png"], ["a10.png", "b10.png", "b.mp4"], ["a#.png", "b.mp4", "b##.png"]),
    ],
)
def test_images_whose_numbers_have_as_many_digits_as_they_need_are_one_sequence(tmp_path, there, chosen, wanted):
    for name in there:
        (tmp_path / name).touch()
    assert [path.name for path in footage_of(tmp_path / name for name in chosen)] == wanted
