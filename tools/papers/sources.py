"""Files that several terms are in, and their tests."""

from __future__ import annotations

FOLLOWING = "core/tracking/solvers/paper_relaxation/gradient_following.py"
RELAXATION = "core/tracking/solvers/paper_relaxation/relaxation.py"
STEPS = "core/tracking/solvers/paper_relaxation/motion_steps.py"
PREDICTION = "core/tracking/solvers/unseen_parts/prediction.py"
KINEMATICS = "core/body/kinematics.py"
SWEEPS = "tests/core/tracking/solvers/paper_relaxation/test_relaxation.py"
ROWS = "tests/core/tracking/solvers/paper_relaxation/test_motion_steps.py"
INITIAL = "tests/core/tracking/solvers/paper_relaxation/test_gradient_following.py"
SERIES = "tests/core/tracking/solvers/unseen_parts/test_prediction.py"
BODY = "tests/core/body/test_body.py"
IMAGES = "tests/core/evidence/gradient_evidence/test_gradients.py"
HIDDEN = "tests/core/evidence/test_occlusion.py"
EXPERIMENTS = "benchmarks/experiments_runs.py"
RUNS = "tests/benchmarks/test_experiments.py"
