"""The manifest, the lock, the package list and the imports say the same thing."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import build_extension
import pytest
from conftest import ROOT, nodes

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
SOURCES = sorted(
    path for part in ("benchmarks", "cli", "core", "kfmocap_addon") for path in (ROOT / part).rglob("*.py")
)


def run_python(code: str, cwd: Path) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True)


def test_manifest_and_project_agree():
    assert MANIFEST["version"] == PROJECT["version"]
    assert MANIFEST["license"] == [f"SPDX:{PROJECT['license']}"]
    assert set(MANIFEST["platforms"]) == set(build_extension.PLATFORMS)


def test_every_wheel_of_the_manifest_is_locked():
    lock = build_extension.read_lock()
    assert [f"./wheels/{name}" for name in lock] == MANIFEST["wheels"]
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in lock.values())


@pytest.mark.parametrize("platform", build_extension.PLATFORMS)
def test_every_platform_has_the_versions_the_project_asks_for(platform):
    wheels = [w for w in build_extension.read_lock() if build_extension.platform_of(w) in (platform, None)]
    for requirement in build_extension.requirements():
        name, version = requirement.split("==")
        found = [w.split("-")[2] for w in wheels if w.startswith(f"{name.replace('-', '_')}-{version}-")]
        expected = ["cp311", "cp313"] if name == "scipy" else [found[0]]
        assert found == expected, requirement
    assert not any(wheel.startswith("numpy") for wheel in wheels)


def test_a_wheel_with_another_hash_is_refused(tmp_path, monkeypatch):
    name = next(iter(build_extension.read_lock()))
    (tmp_path / name).write_bytes(b"not the wheel")
    monkeypatch.setattr(build_extension, "CACHE", tmp_path)
    monkeypatch.setattr(build_extension, "read_lock", lambda: {name: "0" * 64})
    with pytest.raises(build_extension.BuildError, match="SHA-256"):
        build_extension.fetch("linux-x64")


def test_core_imports_without_blender(tmp_path):
    code = """
import importlib, pkgutil, sys

class NoBlender:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"bpy", "mathutils", "addon_utils"}:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, NoBlender())
import kfmocap.core
for module in pkgutil.walk_packages(kfmocap.core.__path__, "kfmocap.core."):
    importlib.import_module(module.name)
"""
    process = run_python(code, tmp_path)
    assert process.returncode == 0, process.stderr


def test_the_root_imports_nothing_heavy(tmp_path):
    code = "import sys, kfmocap; print(*sys.modules.keys() & {'bpy', 'numpy', 'cv2', 'kfmocap.kfmocap_addon'})"
    process = run_python(code, tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stdout.split() == []


def test_imports_are_relative_and_the_core_knows_no_blender():
    wrong = []
    for path in SOURCES:
        names = [alias.name for node in nodes(path) if isinstance(node, ast.Import) for alias in node.names]
        names += [node.module for node in nodes(path) if isinstance(node, ast.ImportFrom) and not node.level]
        forbidden = {"kfmocap", "core", "cli", "kfmocap_addon", "benchmarks"}
        if path.is_relative_to(ROOT / "core"):
            forbidden |= {"bpy", "bpy_extras", "mathutils", "addon_utils"}
        wrong += [f"{path.relative_to(ROOT)}: {name}" for name in names if name.split(".")[0] in forbidden]
    assert wrong == []


def test_the_wheel_holds_every_module_and_the_small_data(tmp_path):
    source = tmp_path / "source"
    # A copy, for setuptools leaves its build/ in the tree it builds from and takes stale files out of it.
    skip = shutil.ignore_patterns(".*", "build", "dist", "wheels", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, ignore=skip)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", tmp_path, source]
    subprocess.run(command, check=True, capture_output=True)
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    examples = [*source.glob("examples/*/shot.toml"), *source.glob("examples/walk/**/*.*")]
    data = [path.relative_to(source) for path in [source / "blender_manifest.toml", *examples]]
    code = [path.relative_to(ROOT) for path in [ROOT / "__init__.py", *SOURCES]]
    assert not {f"kfmocap/{path.as_posix()}" for path in code + data} - held
