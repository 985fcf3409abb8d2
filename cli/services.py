"""What the commands need of the program around them: Blender, where there is one, and the benchmark."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from ..core.errors import OutputError

if TYPE_CHECKING:
    from ..core.numerics.arrays import Array
    from ..core.shot.shot import Shot
    from ..core.tracking.track_result import TrackResult


@dataclass(frozen=True)
class OutputRequest:
    """How the files that Blender writes of a tracked shot are to be.

    Attributes
    ----------
    folder : Path
        The folder to write into.
    home : Path, optional
        The folder that the files are moved to afterwards, by default `folder`; footage near it is referred to by a
        relative path.
    open_scene : bool
        The shot is the open scene's: shot.blend is a copy of the open file with the motion. Otherwise a new scene is
        built.
    leave_out_unknown : bool
        BVH and FBX have no bones of parts that nothing has shown.
    hands : tuple of (ndarray or None)
        Per performer: points of the hands, see `core.keypoints.hand_points`, where files are to have the fingers. None
        for all by default.
    shown : bool
        Blender shows the shot already, as it does in a process that was told to `expect` it.
    """

    folder: Path
    home: Path | None = None
    open_scene: bool = False
    leave_out_unknown: bool = False
    hands: tuple[Array | None, ...] = ()
    shown: bool = False


@dataclass(frozen=True)
class RetargetRequest:
    """One motion file to be put on a character, as the command line asks for it.

    Attributes
    ----------
    motion, character, out : Path
        The BVH or FBX file, the .blend file with the character, and the .blend file to write.
    armature, preset : str, optional
        By default the only candidate, and the preset that fits.
    bone_map, source_map : Path, optional
        Bone maps of the character and of the motion.
    root, feet : str
        See `core.retargeting.transfer.RetargetOptions`.
    hands, layer : bool
    scale : float, optional
    angle, distance : float
        Tolerances of the keys, degrees and millimetres.
    """

    motion: Path
    character: Path
    out: Path
    armature: str | None = None
    preset: str | None = None
    bone_map: Path | None = None
    source_map: Path | None = None
    root: str = "world"
    feet: str = "keep"
    hands: bool = False
    layer: bool = False
    scale: float | None = None
    angle: float = 0.0
    distance: float = 0.0


class BlenderWriter(Protocol):
    """Blender as it writes results."""

    def check(self) -> None:
        """See that it loads, as far as that is known already.

        Raises
        ------
        OutputError
            It does not, as writing says as well.
        """

    def expect(self, shot: Shot, home: Path) -> None:
        """A shot is going to be tracked, and written to a folder: make ready what does not hang on the motion, where
        that does not keep this process from tracking; returns at once.

        What goes wrong is raised when it is written.
        """

    def write_outputs(self, shot: Shot, result: TrackResult, request: OutputRequest) -> list[Path]:
        """Write the BVH and FBX files and shot.blend; returns the files written.

        Raises
        ------
        OutputError
            A file cannot be written.
        """


class BlenderSession(BlenderWriter, Protocol):
    """Blender as the commands use it."""

    def read_shot(self) -> Shot:
        """Read the shot that the open scene shows.

        Raises
        ------
        ShotError
            The scene shows none, or it cannot be tracked.
        """

    def retarget(self, request: RetargetRequest) -> dict[str, Any]:
        """Put a motion on a character and save the file; returns the report.

        Raises
        ------
        ShotError
            A file cannot be read.
        BodyError
            The motion or the character is no human's, or cannot do what is asked for.
        OutputError
            The file cannot be written.
        """


class BlenderProcess(BlenderWriter, Protocol):
    """Blender in a process of its own, where no scene is open: it is loaded while this one does other things."""

    def close(self) -> None:
        """End it."""


@dataclass(frozen=True)
class BenchmarkRequest:
    """What the benchmark is asked to measure.

    Attributes
    ----------
    out : Path, optional
        Folder for the tables.
    shot : str, optional
        One shot only.
    quick : bool
        A few rows only.
    repeat : int
        Number of runs of each case; times are their medians.
    shots : bool
        The set of shots that judges the tracker, instead of the examples.
    data : Path, optional
        Folder of further shots of that set.
    changed : tuple of str
        Settings of the tracker, "NAME=VALUE", with which the set is measured once more.
    speed : bool
        Times by the number of frames, cameras and cores, instead of the examples.
    against : Path, optional
        The folder of another checkout of the program, whose times are measured as well.
    """

    out: Path | None = None
    shot: str | None = None
    quick: bool = False
    repeat: int = 1
    shots: bool = False
    data: Path | None = None
    changed: tuple[str, ...] = ()
    speed: bool = False
    against: Path | None = None


def no_blender() -> NoReturn:
    """Raise the ImportError of a program that does not include Blender."""
    raise ImportError("this installation does not include it")


@dataclass(frozen=True)
class Services:
    """What a program hands to the commands.

    Attributes
    ----------
    load_blender : callable
        Gives a `BlenderSession`, or raises ImportError where Blender's module is missing or does not load.
    start_blender : callable, optional
        Gives a `BlenderProcess`, or raises ImportError where Blender's module is missing.
    in_blender : bool
        The program runs inside Blender: `track` without a shot file tracks the open scene.
    run_benchmark : callable, optional
        Measures, prints tables and returns the exit code; None where the benchmark is not installed.
    """

    load_blender: Callable[[], BlenderSession] = no_blender
    start_blender: Callable[[], BlenderProcess] | None = None
    in_blender: bool = False
    run_benchmark: Callable[[BenchmarkRequest], int] | None = None

    def blender(self) -> BlenderSession:
        """Load Blender.

        Raises
        ------
        OutputError
            It is missing, or does not load.
        """
        with blender_needed():
            return self.load_blender()

    @contextmanager
    def blender_beside(self) -> Iterator[BlenderWriter]:
        """Start Blender for writing results, in a process of its own where the program can.

        Raises
        ------
        OutputError
            Blender is missing, or does not load here.
        """
        if self.start_blender is None:
            yield self.blender()
            return
        with blender_needed():
            process = self.start_blender()
        with closing(process):
            yield process


@contextmanager
def blender_needed() -> Iterator[None]:
    """Say what to do where Blender's module is missing or does not load."""
    try:
        yield
    except ImportError as error:
        raise OutputError(
            f"BVH, FBX and .blend need Blender's module bpy: {error}",
            todo="pip install 'kfmocap[blender]', or leave these files out with --no-blender",
        ) from error
