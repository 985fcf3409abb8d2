"""What the commands need from the surrounding program: Blender, if it is available, and the benchmark."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from ..core.errors import OutputError

if TYPE_CHECKING:
    from ..core.numerics.arrays import Array
    from ..core.runtime.processes.worker_memory import WorkerMemory
    from ..core.shot.shot import Shot
    from ..core.tracking.results.track_result import TrackResult


@dataclass(frozen=True)
class OutputRequest:
    """Options of the files that Blender writes for a tracked shot.

    Attributes
    ----------
    folder : Path
        The folder to write into.
    home : Path, optional
        The folder to which the files are moved afterwards, by default `folder`; footage near it gets a relative path.
    open_scene : bool
        Whether the shot was read from the open scene: shot.blend is then a copy of the open file with the motion.
        Otherwise a new scene is built.
    leave_out_unknown : bool
        Whether BVH and FBX leave out the bones of parts that nothing has shown.
    hands : tuple of (ndarray or None)
        Per performer: points of the hands, see `core.keypoints.hand_points`, or None for files without fingers. Empty
        for no fingers at all.
    shown : bool
        Whether Blender's scene shows the shot already, as after `BlenderWriter.prepare`.
    """

    folder: Path
    home: Path | None = None
    open_scene: bool = False
    leave_out_unknown: bool = False
    hands: tuple[Array | None, ...] = ()
    shown: bool = False


@dataclass(frozen=True)
class RetargetRequest:
    """One motion file to be put on a character.

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
        Tolerances for leaving out keys, degrees and millimetres.
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
    """Blender, for writing results and for putting motions on characters."""

    def check(self) -> None:
        """Check that Blender loads, as far as that is known already.

        Raises
        ------
        OutputError
            It does not; writing raises the same error.
        """

    def prepare(self, shot: Shot, home: Path, beside: Path | None = None) -> None:
        """Prepare everything for a shot that does not depend on its motion, if another process can do so.

        Returns at once; errors are raised when the results are written.

        Parameters
        ----------
        shot : Shot
            The shot that is going to be tracked.
        home : Path
            See `OutputRequest`.
        beside : Path, optional
            A folder that exists, in the same one as `home` if that is still to be made.
        """

    def write_outputs(self, shot: Shot, result: TrackResult, request: OutputRequest) -> list[Path]:
        """Write the BVH and FBX files and shot.blend, and return the files written. It is the last call.

        Raises
        ------
        OutputError
            A file cannot be written.
        """

    def retarget(self, request: RetargetRequest) -> dict[str, Any]:
        """Put a motion on a character and save the file; returns the report.

        Raises
        ------
        ShotError
            A file cannot be read.
        BodyError
            The motion or the character is not human, or does not support an option.
        OutputError
            The file cannot be written.
        """


class BlenderSession(BlenderWriter, Protocol):
    """Blender, for everything that the commands need."""

    def open_file(self) -> Path | None:
        """Return the file that is open; None if the scene was never saved."""

    def read_shot(self) -> Shot:
        """Read the shot of the open scene.

        Raises
        ------
        ShotError
            The scene has none, or it cannot be tracked.
        """


class BlenderProcess(BlenderWriter, Protocol):
    """Blender in a separate process without an open scene, which is loaded while this process does other work."""

    def close(self) -> None:
        """End the process."""


@dataclass(frozen=True)
class BenchmarkRequest:
    """What the benchmark measures.

    Attributes
    ----------
    out : Path, optional
        Folder for the tables.
    shot : str, optional
        Name of the only shot to measure.
    quick : bool
        Whether to measure only a few rows.
    repeat : int
        Number of runs of each case; times are their medians.
    shots : bool
        Whether to measure the set of shots that judges the tracker, instead of the examples.
    data : Path, optional
        Folder with further shots for that set.
    changed : tuple of str
        Settings of the tracker, "NAME=VALUE", with which the set is measured a second time.
    speed : bool
        Whether to measure times by the number of frames, cameras and cores, instead of the examples.
    against : Path, optional
        Folder of another checkout of the program, whose times are measured as well.
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
    """What the program provides to the commands.

    Attributes
    ----------
    load_blender : callable
        Returns a `BlenderSession`; raises ImportError if Blender's module is missing or does not load.
    start_blender : callable, optional
        Returns a `BlenderProcess`; raises ImportError if Blender's module is missing.
    in_blender : bool
        Whether the program runs inside Blender: `track` without a shot file then tracks the open scene.
    run_benchmark : callable, optional
        Called with a `BenchmarkRequest`; prints tables and returns the exit code. None if the benchmark is not
        installed.
    workers : WorkerMemory, optional
        Processes for tracking that were started before the command's own libraries were loaded.
    """

    load_blender: Callable[[], BlenderSession] = no_blender
    start_blender: Callable[[], BlenderProcess] | None = None
    in_blender: bool = False
    run_benchmark: Callable[[BenchmarkRequest], int] | None = None
    workers: WorkerMemory | None = None

    def blender(self) -> BlenderSession:
        """Load Blender.

        Raises
        ------
        OutputError
            Blender is missing, or does not load.
        """
        with blender_needed():
            return self.load_blender()

    @contextmanager
    def blender_beside(self) -> Iterator[BlenderWriter]:
        """Provide Blender for writing results, in a separate process if possible.

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
    """Turn the ImportError of a missing Blender into an OutputError that says what to do."""
    try:
        yield
    except ImportError as error:
        raise OutputError(
            f"BVH, FBX and .blend need Blender's module bpy: {error}",
            todo="pip install 'kfmocap[blender]', or leave these files out with --no-blender",
        ) from error
