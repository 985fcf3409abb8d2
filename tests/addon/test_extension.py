"""The zip that users install, in a Blender that has nothing of ours: it registers, and it tracks."""

from __future__ import annotations

import json
import zipfile

import pytest
from short_walk import short_walk

pytestmark = [pytest.mark.blender, pytest.mark.long]

BUNDLED = ("scipy", "cv2", "filterpy", "threadpoolctl")
SETTINGS = ["working_size = 120", "limb_search = false"]


def test_the_zip_holds_the_package_and_no_more(extension_zip):
    with zipfile.ZipFile(extension_zip) as archive:
        names = archive.namelist()
    top = {name.split("/")[0] for name in names}
    assert top == {
        "blender_manifest.toml",
        "__init__.py",
        "LICENSE",
        "README.md",
        "cli",
        "core",
        "kfmocap_addon",
        "wheels",
    }
    assert not [name for name in names if "__pycache__" in name]


@pytest.fixture(scope="module")
def session(extension):
    """What one session of Blender with the extension sees, step by step."""
    printed = extension.run(f"""
        import importlib, json, pkgutil, sys
        seen = {{"loaded": [n for n in {BUNDLED!r} if n in sys.modules]}}
        seen["files"] = {{n: importlib.import_module(n).__file__ for n in {BUNDLED!r}}}
        package = importlib.import_module({extension.module!r})
        names = [module.name for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".")]
        seen["modules"] = [importlib.import_module(name).__name__ for name in names]
        seen["enabled"] = dir(bpy.ops.kfmocap)
        addon_utils.disable({extension.module!r})
        seen["disabled"] = dir(bpy.ops.kfmocap)
        print("\\n" + json.dumps(seen))
    """)
    return json.loads(printed)


def test_enabling_loads_nothing_heavy(session):
    """Blender starts as fast as without it: the core's libraries are loaded by the tool that needs them."""
    assert session["loaded"] == []


def test_the_bare_environment_brings_no_wheel_of_ours(extension):
    found = extension.run_bare(
        f"import importlib.util, json\nprint(json.dumps([n for n in {BUNDLED!r} if importlib.util.find_spec(n)]))"
    )
    assert json.loads(found) == [], "the bare environment has these itself and would hide a missing wheel"


def test_the_extension_uses_its_own_wheels(extension, session):
    for name, path in session["files"].items():
        assert path.startswith(str(extension.resources / "extensions")), f"{name} comes from {path}"


def test_every_module_imports(session):
    assert len(session["modules"]) > 100


def test_operators_are_registered_and_unregistered(session):
    assert session["enabled"], "the extension registers no operator bpy.ops.kfmocap.*"
    assert session["disabled"] == []


def test_the_installed_extension_tracks_the_small_example(extension, tmp_path):
    shot, out = short_walk(tmp_path / "walk", 4, settings=SETTINGS) / "shot.toml", tmp_path / "out"
    printed = extension.run(f"""
        import importlib
        batch = importlib.import_module({extension.module!r} + ".kfmocap_addon.batch")
        arguments = ["track", {str(shot)!r}, "--views", "cam01,cam02", "--out", {str(out)!r}]
        print("\\nexit code", batch.run_command(arguments))
    """)
    assert printed == "exit code 0"
    written = {path.suffix for path in out.iterdir() if path.stat().st_size}
    assert {".trc", ".bvh", ".fbx"} <= written
