"""Clocks of another take: a wand is waved in front of cameras that were restarted but have not moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..cameras.camera import Camera
from ..capture.capture import Capture
from ..errors import CalibrationError
from ..numerics.robust_kernels import Cauchy
from ..runtime.progress import Progress, report_progress
from . import findings
from .solving.bundle import adjust, covariance
from .solving.bundle_scene import BundleEvidence, Scene
from .solving.camera_rig import CAMERA_DOF, DRIFT, OFFSET, rig_of
from .solving.clocks import Clocks
from .solving.synchrony import find_synchrony, with_capture_clock
from .solving.view_links import MIN_LINK_FRAMES
from .solving.wand_triangulation import sight
from .wand_matching import labelled

_LOOSE_GATE = 10.0  # standard deviations, while the clocks are still inexact
_ROUNDS = 4  # of selecting the wand's balls and estimating the clocks


def synchronise(
    capture: Capture, cameras: Mapping[str, Camera], progress: Progress | None = None, *, drift: bool = False
) -> Clocks:
    """Find the clocks of a take whose cameras are known. Its L-frame is ignored.

    Parameters
    ----------
    capture : Capture
    cameras : mapping of str to Camera
        The solved cameras by name.
    progress : callable, optional
    drift : bool
        Whether clocks may also run at different speeds.

    Raises
    ------
    CalibrationError
        A view's camera is not among the known ones.
    CaptureError
        The wand's path does not determine the clocks.
    CancelledError
        `progress` returned False.
    """

    def check() -> None:
        report_progress(progress, "offsets", 0.0)

    check()
    synchrony = find_synchrony(capture)
    rig = rig_of([known_camera(cameras, view.camera, view.size) for view in capture.views])
    rig = replace(rig, rate=synchrony.rate, offset=synchrony.offset)
    free = np.zeros((len(rig), CAMERA_DOF), bool)
    free[:, OFFSET], free[:, DRIFT] = synchrony.estimated, synchrony.estimated & drift
    noise = _LOOSE_GATE
    for _ in range(_ROUNDS):
        tracks = synchrony.tracks(rig)
        wand = sight(with_capture_clock(rig), tracks, capture.wand_length, noise).wand(
            tracks.frames, capture.wand_length
        )
        if len(wand) < MIN_LINK_FRAMES:
            raise findings.nothing_agrees().error()
        scene = Scene(rig, wand)
        seen, _ = labelled(scene, capture.views, noise)
        evidence = BundleEvidence(seen, smooth=synchrony.needs_interpolation)
        fit = adjust(scene, evidence, free, kernel=Cauchy(4 * noise), cancel=check)
        rig, noise = fit.scene.rig, max(fit.noise, 1.0)
    sigma = noise * np.sqrt(np.diag(covariance(fit.scene, evidence, fit.free))).reshape(-1, CAMERA_DOF)
    return Clocks.of(rig, sigma)


def known_camera(cameras: Mapping[str, Camera], name: str, size: tuple[int, int]) -> Camera:
    """Return the camera of a view.

    Raises
    ------
    CalibrationError
        It is unknown, has another size, moves, or has a fisheye lens.
    """
    where = f"camera {name}"
    if name not in cameras:
        todo = f"there are {', '.join(cameras)}"
        raise CalibrationError("the calibration does not have it", where=where, todo=todo)
    camera = cameras[name]
    if camera.size != size:
        sizes = " and ".join(f"{w}x{h}" for w, h in (camera.size, size))
        raise CalibrationError(f"the sizes of calibration and video are {sizes}", where=where)
    if camera.moving or camera.fisheye:
        raise CalibrationError("a wand needs fixed cameras without fisheye lenses", where=where)
    return camera
