"""What the tests share: markers that skip by themselves, and the extension installed in a bare Blender."""

from __future__ import annotations

import ast
import gc
import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import hypothesis
import pytest
import threadpoolctl
from bare_environment import make_bare_environment

ROOT = Path(__file__).resolve().parents[1]

hypothesis.settings.register_profile("kfmocap", deadline=None, max_examples=50)
hypothesis.settings.register_profile("nightly", deadline=None, max_examples=500)

# Read by bpy when it is first imported: no test may touch the user's own Blender settings.
os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="kfmocap-blender-")


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file. Several tests read all of the code: each file is parsed once."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file's syntax tree."""
    return tuple(ast.walk(parsed(path)))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--nightly", action="store_true", help="random tests at their full size")
    parser.addoption("--undo-sequences", type=int, help="how many random sequences of tools are undone and redone")
    parser.addoption("--damaged", type=int, default=10, help="how many damaged files of every kind are read")


def pytest_configure(config: pytest.Config) -> None:
    # A shell has its background programs ignore the one, nohup the other, and so would the programs that tests start.
    for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    hypothesis.settings.load_profile("nightly" if config.getoption("nightly") else "kfmocap")
    if "PYTEST_XDIST_WORKER" in os.environ:
        take_a_core()
        # Loaded first, for what is not loaded has no number of threads.
        importlib.import_module("scipy.linalg")
        threadpoolctl.threadpool_limits(1, user_api="blas")
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the programs that tests start


def take_a_core() -> None:
    """Keep a test process, and what it starts, on one core if each core has one: threads and worker processes of the
    tracker would only wait for those of the other test processes. Tests of several processes ask for them.
    """
    if not hasattr(os, "sched_setaffinity"):
        return
    cores = sorted(os.sched_getaffinity(0))
    if int(os.environ["PYTEST_XDIST_WORKER_COUNT"]) >= len(cores):
        worker = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
        os.sched_setaffinity(0, {cores[worker % len(cores)]})


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    # What is loaded stays: to look through it for garbage takes a quarter of the time, and later each time anew.
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_sessionfinish() -> None:
    shutil.rmtree(os.environ["BLENDER_USER_RESOURCES"], ignore_errors=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    needs = {
        "blender": (importlib.util.find_spec("bpy"), "the bpy module is not installed"),
        "application": (shutil.which("blender"), "no Blender application on the PATH"),
    }
    for item in items:
        for marker, (found, reason) in needs.items():
            if found is None and item.get_closest_marker(marker):
                item.add_marker(pytest.mark.skip(reason=reason))
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


ENDS_WITHIN = 300
"""Time in which a Blender with the extension must have done its work and ended, seconds."""


@dataclass(frozen=True)
class InstalledExtension:
    """The built zip, installed in an environment that holds Blender and nothing of ours."""

    python: Path
    resources: Path
    module: str = "bl_ext.user_default.kfmocap"

    def run(self, code: str) -> str:
        """Run code in a new Blender with the extension enabled; return what it printed last."""
        enable = f"import addon_utils; addon_utils.enable({self.module!r}, default_set=True)\n"
        return self.run_bare("import bpy\n" + enable + textwrap.dedent(code))

    def run_bare(self, code: str) -> str:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        environment |= {"BLENDER_USER_RESOURCES": str(self.resources), "PYTHONNOUSERSITE": "1"}
        process = subprocess.run(
            [self.python, "-c", code],
            env=environment,
            cwd=self.resources,
            capture_output=True,
            text=True,
            timeout=ENDS_WITHIN,
        )
        assert process.returncode == 0, process.stdout + process.stderr
        return (process.stdout.strip().splitlines() or [""])[-1]


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension as `make extension` builds it, for this machine."""
    import build_extension

    [zip_path] = build_extension.build([build_extension.this_platform()], tmp_path_factory.mktemp("dist"))
    return zip_path


@pytest.fixture(scope="session")
def extension(extension_zip: Path, tmp_path_factory: pytest.TempPathFactory) -> InstalledExtension:
    bare = make_bare_environment(tmp_path_factory.mktemp("bare") / "environment")
    installed = InstalledExtension(bare, tmp_path_factory.mktemp("blender"))
    installed.run_bare(
        f"import bpy\nbpy.ops.extensions.package_install_files(filepath={str(extension_zip)!r}, repo='user_default')\n"
    )
    return installed
