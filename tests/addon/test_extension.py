"""The zip that users install, in a Blender that has nothing of ours: it registers, and it tracks."""

from __future__ import annotations

import json
import zipfile

import pytest
from conftest import ROOT

pytestmark = pytest.mark.blender

SHOT = ROOT / "examples" / "walk" / "shot.toml"
OPERATORS = ROOT / "kfmocap_addon" / "operators"
BUNDLED = ("scipy", "cv2", "filterpy", "threadpoolctl")


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


def test_enabling_loads_nothing_heavy(extension):
    """Blender starts as fast as without it: the core's libraries are loaded by the tool that needs them."""
    heavy = extension.run(f"import json, sys\nprint(json.dumps([n for n in {BUNDLED!r} if n in sys.modules]))")
    assert json.loads(heavy) == []


def test_the_bare_environment_brings_no_wheel_of_ours(extension):
    found = extension.run_bare(
        f"import importlib.util, json\nprint(json.dumps([n for n in {BUNDLED!r} if importlib.util.find_spec(n)]))"
    )
    assert json.loads(found) == [], "the bare environment has these itself and would hide a missing wheel"


def test_the_extension_uses_its_own_wheels(extension):
    printed = extension.run(f"""
        import importlib, json
        print(json.dumps({{n: importlib.import_module(n).__file__ for n in {BUNDLED!r}}}))
    """)
    for name, path in json.loads(printed).items():
        assert path.startswith(str(extension.resources / "extensions")), f"{name} comes from {path}"


def test_every_module_imports(extension):
    extension.run(f"""
        import importlib, pkgutil
        package = importlib.import_module({extension.module!r})
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            importlib.import_module(module.name)
    """)


@pytest.mark.skipif(not OPERATORS.exists(), reason="kfmocap_addon/operators is not there")
def test_operators_are_registered_and_unregistered(extension):
    printed = extension.run(f"""
        import json
        before = dir(bpy.ops.kfmocap)
        addon_utils.disable({extension.module!r})
        print(json.dumps([before, dir(bpy.ops.kfmocap)]))
    """)
    enabled, disabled = json.loads(printed)
    assert enabled, "the extension registers no operator bpy.ops.kfmocap.*"
    assert disabled == []


@pytest.mark.skipif(not SHOT.exists(), reason="examples/walk is not there")
def test_the_installed_extension_tracks_the_small_example(extension, tmp_path):
    printed = extension.run(f"""
        import importlib
        batch = importlib.import_module({extension.module!r} + ".kfmocap_addon.batch")
        arguments = ["track", {str(SHOT)!r}, "--views", "cam01,cam02", "--out", {str(tmp_path)!r}]
        print("\\nexit code", batch.run_command(arguments))
    """)
    assert printed == "exit code 0"
    written = {path.suffix for path in tmp_path.iterdir() if path.stat().st_size}
    assert {".trc", ".bvh", ".fbx"} <= written
