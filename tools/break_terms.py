"""Break each term of the papers in a copy of the program, and see that the test fails that watches over it.

    .venv/bin/python tools/break_terms.py [--only "(27)"]

The terms are those of docs/papers.md. The exit code is 1 if a broken term is not noticed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RELAXATION = "core/tracking/solvers/relaxation.py"
STEPS = "core/tracking/solvers/motion_steps.py"
PREDICTION = "core/tracking/prediction.py"
KINEMATICS = "core/body/kinematics.py"
SWEEPS = "tests/core/tracking/test_relaxation.py"
SERIES = "tests/core/tracking/test_prediction.py"
BODY = "tests/core/body/test_body.py"
IMAGES = "tests/core/evidence/test_gradients.py"
HIDDEN = "tests/core/evidence/test_occlusion.py"
EXPERIMENTS = "benchmarks/experiments_runs.py"
RUNS = "tests/benchmarks/test_experiments.py"


@dataclass(frozen=True)
class Term:
    """A term and a way to break it.

    Attributes
    ----------
    item : str
        What the papers call it, as in the first column of docs/papers.md.
    file : str
    right, wrong : str
        A piece of the file that is there once, and what it is replaced by.
    test : str
        The test that then fails: its file and its name.
    """

    item: str
    file: str
    right: str
    wrong: str
    test: str


TERMS = (
    Term(
        "(1)",
        "core/cameras/camera.py",
        "x = (points @ R.T + t)",
        "x = (points @ R.T - t)",
        "tests/core/cameras/test_cameras.py::test_projection_is_the_formula",
    ),
    Term(
        "(2), (9)",
        "core/evidence/image_wrenches.py",
        "mz = -(mx * x + my * y) / z",
        "mz = (mx * x + my * y) / z",
        f"{IMAGES}::test_standing_still_before_a_flash_the_sums_are_the_derivatives",
    ),
    Term(
        "(3)",
        KINEMATICS,
        "T[:, p] + R[:, p] @ body.offsets[i]",
        "T[:, p] - R[:, p] @ body.offsets[i]",
        f"{BODY}::test_forward_kinematics_is_the_product_along_the_chain",
    ),
    Term(
        "(5)",
        STEPS,
        "np.swapaxes(Q[:-1], -1, -2) @ Q[1:]",
        "Q[1:] @ np.swapaxes(Q[:-1], -1, -2)",
        f"{SWEEPS}::test_steps_accumulate_to_the_motion_they_are_of",
    ),
    Term(
        "(6)",
        STEPS,
        "turned.append(turned[-1] @ Q)",
        "turned.append(Q @ turned[-1])",
        f"{SWEEPS}::test_steps_accumulate_to_the_motion_they_are_of",
    ),
    Term(
        "(7)",
        STEPS,
        "np.cumsum(self.shifts, axis=0)",
        "self.shifts",
        f"{SWEEPS}::test_steps_accumulate_to_the_motion_they_are_of",
    ),
    Term(
        "(8)",
        "core/evidence/compared_pixels.py",
        "there, there[0] - here[0], seen)",
        "there, here[0] - there[0], seen)",
        f"{IMAGES}::test_standing_still_before_a_flash_the_sums_are_the_derivatives",
    ),
    Term(
        "(10), (11)",
        KINEMATICS,
        "J[:, below, :3, columns] = moments[:, None, k]",
        "J[:, below, :3, columns] = -moments[:, None, k]",
        f"{BODY}::test_twist_jacobian_is_the_derivative_of_the_part_poses",
    ),
    Term(
        "(12)",
        RELAXATION,
        "-np.linalg.solve(A, blocks.gradient[1] + damped)",
        "np.linalg.solve(A, blocks.gradient[1] + damped)",
        f"{SWEEPS}::test_gradients_alone_follow_an_arm_that_is_seen",
    ),
    Term(
        "(12), drift",
        RELAXATION,
        "s**2 * (3 - s) / 2 * np.where",
        "s * np.where",
        f"{SWEEPS}::test_an_initial_solution_ends_at_the_key_pose_and_has_lost_most_of_its_drift",
    ),
    Term(
        "(13) to (18)",
        KINEMATICS,
        "R[:, i] = R[:, p] @ (",
        "R[:, i] = (",
        f"{BODY}::test_forward_kinematics_is_the_product_along_the_chain",
    ),
    Term(
        "(14), (19)",
        RELAXATION,
        "T_last - motion.translations[0] - x[:, :3].sum(axis=0)",
        "T_last - motion.translations[0] + x[:, :3].sum(axis=0)",
        f"{SWEEPS}::test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does",
    ),
    Term(
        "(20)",
        RELAXATION,
        "ends = x[max(j - 1, 0)] + x[min(j + 1, n - 1)]",
        "ends = 2 * x[j]",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "(21)",
        RELAXATION,
        "smooth * ends / 2)",
        "smooth * ends)",
        f"{SWEEPS}::test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does",
    ),
    Term(
        "(22), (23)",
        RELAXATION,
        "before = before @ rotations.exp(new[3:].reshape(-1, 3))",
        "before = before @ Q[j]",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "(22), of later frames",
        STEPS,
        "out[j - 1] += self.carried[j].T @ out[j]",
        "out[j - 1] += 0 * self.carried[j].T @ out[j]",
        f"{SWEEPS}::test_the_derivative_by_a_step_has_the_rows_of_all_poses_that_it_moves",
    ),
    Term(
        "(30), within a sweep",
        RELAXATION,
        "b -= rows.first[j] @ moved + rows.second[j] @ moved_before",
        "b -= 0 * rows.first[j] @ moved",
        f"{SWEEPS}::test_a_sweep_solves_each_step_for_the_whole_derivative",
    ),
    Term(
        "(24) to (26)",
        RELAXATION,
        "P = np.swapaxes(before, -1, -2) @ R_last @ np.swapaxes(after[j], -1, -2)",
        "P = np.swapaxes(after[j], -1, -2) @ R_last @ np.swapaxes(before, -1, -2)",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "(27)",
        RELAXATION,
        "x_e = u * (x_e - x[j]) + x[j]",
        "x_e = 1.0 * x_e",
        f"{SWEEPS}::test_one_sweep_takes_a_part_of_the_error_and_never_all_of_it_in_one_frame",
    ),
    Term(
        "(28)",
        RELAXATION,
        "if whole else (1.0 / n, 1.0)",
        "if whole else (0.5 / n, 1.0)",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "(29), (30)",
        RELAXATION,
        "new = inverse[j] @ (b + weight * x_e",
        "new = inverse[j] @ (b + x_e",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "λ = 10",
        RELAXATION,
        "LAMBDA = 10.0",
        "LAMBDA = 11.0",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "ν = 20",
        RELAXATION,
        "NU = 20.0",
        "NU = 21.0",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "smoothness 1",
        RELAXATION,
        "SMOOTHNESS = 1.0",
        "SMOOTHNESS = 1.1",
        f"{SWEEPS}::test_a_sweep_over_turns_is_equation_30_with_the_papers_weights",
    ),
    Term(
        "units of the weights",
        "core/evidence/segment_evidence.py",
        "return np.asarray(count * self.sampling.stride**2 / (density * correlation_length**2))",
        "return np.asarray(count / (density * correlation_length**2))",
        f"{SWEEPS}::test_weights_mean_the_same_at_every_resolution_and_stride",
    ),
    Term(
        "unit of length",
        RELAXATION,
        "np.full(3, length)",
        "np.full(3, 1.0)",
        f"{SWEEPS}::test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does",
    ),
    Term(
        "(31)",
        PREDICTION,
        "a - reflection * a[::-1]",
        "a + reflection * a[::-1]",
        f"{SERIES}::test_levinson_solves_the_toeplitz_equations",
    ),
    Term(
        "(32) to (37)",
        PREDICTION,
        "kalman.F = np.eye(h, k=-1)",
        "kalman.F = np.eye(h)",
        f"{SERIES}::test_prediction_is_the_recursion_of_the_model_and_its_variance",
    ),
    Term(
        "section 5.3",
        "core/evidence/occlusion.py",
        "hidden = share < OCCLUDED_BELOW",
        "hidden = share > OCCLUDED_BELOW",
        f"{HIDDEN}::test_a_part_is_unseen_where_every_view_has_lost_it",
    ),
    Term(
        "figure 1",
        "core/evidence/occlusion.py",
        "hidden | (predicted < OCCLUDED_BELOW)",
        "hidden & (predicted < OCCLUDED_BELOW)",
        f"{HIDDEN}::test_a_part_is_occluded_in_its_current_or_its_predicted_pose",
    ),
    Term(
        "section 5.4, figure 2",
        RELAXATION,
        "_moved_by_gradients(pair, here, gone, workspace, FIRST",
        "_moved_by_gradients(pair, here, [np.zeros_like(g) for g in gone], workspace, FIRST",
        f"{SWEEPS}::test_a_hidden_parts_pixels_move_nothing_in_the_initial_solution",
    ),
    Term(
        "(38)",
        "core/evidence/segment_evidence.py",
        "~hidden, ~(hidden[:-1] | hidden[1:])",
        "~hidden, ~(hidden[:-1] & ~hidden[1:])",
        f"{SWEEPS}::test_pixels_of_hidden_parts_do_not_count_in_the_sweeps",
    ),
    Term(
        "(A.1), (A.2)",
        RELAXATION,
        "return 0.5 * np.stack(",
        "return 0.25 * np.stack(",
        f"{SWEEPS}::test_axis_vector_is_that_of_the_odd_half",
    ),
    Term(
        "(A.3), (A.4)",
        RELAXATION,
        "np.concatenate([T_error + x[j, :3]",
        "np.concatenate([T_error - x[j, :3]",
        f"{SWEEPS}::test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does",
    ),
    Term(
        "(A.5), (A.6)",
        RELAXATION,
        "x[max(j - 1, 0)]",
        "x[j - 1]",
        f"{SWEEPS}::test_of_translations_alone_it_finds_the_minimum_of_the_energy_as_a_dense_solve_does",
    ),
    Term(
        "appendix 4",
        PREDICTION,
        "kalman.Q = model.variance * G @ G.T",
        "kalman.Q = 0.5 * model.variance * G @ G.T",
        f"{SERIES}::test_prediction_is_the_recursion_of_the_model_and_its_variance",
    ),
    Term(
        "observation noise",
        PREDICTION,
        "kalman.R *= model.noise",
        "kalman.R *= 1e-9 * model.noise",
        f"{SERIES}::test_noise_that_is_observed_is_not_predicted",
    ),
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
        "(4)",
        "core/numerics/rotations.py",
        "Rotation.from_rotvec(_listed(v",
        "Rotation.from_rotvec(-_listed(v",
        "tests/core/numerics/test_rotations.py::test_exp_turns_by_the_right_hand",
    ),
    Term(
        "paper 1, section 2.3: key poses by hand",
        "core/posing/clicks.py",
        "weights = self.clicks.confidence / CLICK_DEVIATION**2",
        "weights = 0 * self.clicks.confidence / CLICK_DEVIATION**2",
        "tests/core/posing/test_posing.py::test_clicks_in_two_views_with_a_pixel_of_noise_give_the_joints_to_15_mm",
    ),
    Term(
        "paper 1, section 6: more key poses divide the shot",
        "core/tracking/segments.py",
        "reduce(set.intersection",
        "reduce(set.union",
        "tests/core/tracking/test_tracking.py::test_segments_meet_where_every_performer_has_a_whole_key_pose",
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
        "core/evidence/label_images.py",
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
        "paper 1, figures 3 and 4: the walk",
        EXPERIMENTS,
        'for joints in (LEG, ARM) for side in "RL"',
        'for joints in (LEG, ARM) for side in "LR"',
        f"{RUNS}::test_the_walk_is_tracked_with_and_without_each_part_by_both_solvers",
    ),
    Term(
        "paper 1, figures 5 and 6: the throw",
        EXPERIMENTS,
        '*(("relaxation", s) for s in SWEEPS)]',
        '*(("relaxation", s) for s in SWEEPS[1:])]',
        f"{RUNS}::test_the_throw_is_solved_both_ways",
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
        "return 1 / (KEY_PIECE * self.tolerance**2)",
        "return 0 / (KEY_PIECE * self.tolerance**2)",
        "tests/core/fitting/test_body_fit.py::test_a_body_of_another_size_is_found_from_its_outlines",
    ),
    Term(
        "paper 2, section 5: a day's shoot",
        "core/calibration/resync.py",
        "offset=together.offset)",
        "offset=-together.offset)",
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


def broken_copy(term: Term, folder: Path) -> None:
    """Copy the files that git knows of, and break a term in the copy."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        target = folder / "kfmocap" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file() and (not name.startswith("docs/") or name.endswith(".md")):
            shutil.copy(ROOT / name, target)
    file = folder / "kfmocap" / term.file
    file.write_text(file.read_text(encoding="utf-8").replace(term.right, term.wrong), encoding="utf-8")


def is_noticed(term: Term) -> bool:
    """Whether the test of a term fails when the term is broken."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        broken_copy(term, folder)
        environment = os.environ | {"PYTHONPATH": str(folder)}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", term.test]
        ran = subprocess.run(
            command, cwd=folder / "kfmocap", env=environment, capture_output=True, text=True, check=False
        )
        return ran.returncode == 1 and f"FAILED {term.test}" in ran.stdout


def main(argv: Sequence[str] | None = None) -> int:
    """Break the terms one after the other; returns the exit code."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--only", default="", metavar="TEXT", help="terms whose names contain this")
    chosen = [term for term in TERMS if arguments.parse_args(argv).only in term.item]
    missed = 0
    for term in chosen:
        noticed = is_noticed(term)
        missed += not noticed
        print(f"{'noticed' if noticed else 'NOT NOTICED':12}{term.item:24}{term.test.rpartition('::')[2]}", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} broken terms are noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
