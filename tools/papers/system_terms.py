"""Terms of the second paper: cameras, key poses and performers."""

from __future__ import annotations

from .sources import BODY, EXPERIMENTS, HIDDEN, KINEMATICS, RUNS
from .term import Term

SYSTEM_TERMS = (
    Term(
        "paper 2, (1)",
        "core/calibration/solving/wand_motion.py",
        "half = self.length / 2 * self.direction",
        "half = self.length * self.direction",
        "tests/core/calibration/solving/test_bundle.py::test_the_wand_keeps_its_length_exactly",
    ),
    Term(
        "paper 2, section 3.1, Levenberg-Marquardt",
        "core/calibration/solving/bundle_residuals.py",
        "(uv - seen.uv) * np.broadcast_to(reached",
        "(seen.uv - uv) * np.broadcast_to(reached",
        "tests/core/calibration/solving/test_bundle.py::test_derivatives_agree_with_finite_differences",
    ),
    Term(
        "paper 2, section 3.1, colours",
        "core/capture/colours.py",
        "spans = [(first, last)] if first <= last else [(first, 360.0), (0.0, last)]",
        "spans = [(first, last)]",
        "tests/core/capture/test_colours.py::test_a_range_of_hue_goes_through_red",
    ),
    Term(
        "paper 2, (2) to (4)",
        KINEMATICS,
        "R[:, i] = body.R_parent_rest[i] @ motion.rotations[:, i]",
        "R[:, i] = motion.rotations[:, i] @ body.R_parent_rest[i]",
        f"{BODY}::test_forward_kinematics_is_the_product_along_the_chain",
    ),
    Term(
        "paper 2, section 3.2: 2D points become a 3D pose",
        "core/posing/clicks.py",
        "x, y, w = np.linalg.solve(matrix, [*pixel, 1.0])",
        "x, y, w = np.linalg.solve(matrix.T, [*pixel, 1.0])",
        "tests/core/posing/test_posing.py::test_pixels_and_places_are_each_others_inverse",
    ),
    Term(
        "paper 2, section 3.2: several performers",
        "core/evidence/rendering/label_images.py",
        "np.minimum(np.diff(ends) / outlines.areas, 1.0)",
        "np.maximum(np.diff(ends) / outlines.areas, 1.0)",
        f"{HIDDEN}::test_another_performer_hides_a_part",
    ),
    Term(
        "paper 2, section 3.3: several cameras against occlusion",
        "core/evidence/occlusion.py",
        "occluded(share, predicted).all(axis=0)",
        "occluded(share, predicted).any(axis=0)",
        f"{HIDDEN}::test_a_part_is_unseen_where_every_view_has_lost_it",
    ),
    Term(
        "paper 2, figure 3: the turn",
        EXPERIMENTS,
        "track(excerpt(selected(shot, views=[camera]), first",
        "track(excerpt(shot, first",
        f"{RUNS}::test_the_turn_is_tracked_with_one_camera_a_switched_one_and_all",
    ),
    Term(
        "paper 2, section 3.2: the model is laid over the outline",
        "core/fitting/outline_fit.py",
        "return 1 / (KEY_FRAME_PIECE * self.tolerance**2)",
        "return 0 / (KEY_FRAME_PIECE * self.tolerance**2)",
        "tests/core/fitting/test_body_fit.py::test_a_body_of_another_size_is_found_from_its_outlines",
    ),
    Term(
        "paper 2, section 5: a day's shoot",
        "core/calibration/resync.py",
        "offset=synchrony.offset)",
        "offset=-synchrony.offset)",
        "tests/core/formats/test_wand_files.py::test_a_take_of_known_cameras_is_synchronised",
    ),
    Term(
        "paper 2, figures 1 and 2: L-frame, wand, body model",
        "core/calibration/lframe/lframe_pose.py",
        "shift = measures[known].mean(axis=0) - R @",
        "shift = measures[known].mean(axis=0) + R @",
        "tests/core/calibration/test_wand_solution.py::test_two_cameras_are_enough",
    ),
)
