"""Make the type stubs of Blender's modules readable for mypy on Python 3.11.

    python tools/make_stubs.py build/stubs

fake-bpy-module declares generic classes and functions in the notation of Python 3.12 (PEP 695), which Blender 5.0's own
Python 3.11 cannot parse. The stubs are copied with the notation of `typing.Generic`. What they leave out is
added: the properties that the add-on registers, custom properties, and that Blender returns subtypes.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sysconfig
from pathlib import Path

MODULES = ("addon_utils", "blf", "bmesh", "bpy", "bpy_extras", "gpu", "gpu_extras", "idprop", "imbuf", "mathutils")
_GENERIC_CLASS = re.compile(r"^class (\w+)\[([^\]]+)\](?:\(([^)]*)\))?:", re.MULTILINE)
_GENERIC_FUNCTION = re.compile(r"^(\s*def \w+)\[([^\]]+)\]\(", re.MULTILINE)


_RESULTS = (
    *("BoolProperty", "FloatProperty", "FloatVectorProperty", "PointerProperty"),
    *("register_classes_factory", "register_cli_command", "id_properties_ui", "driver_add"),
    *("active_framebuffer_get", "viewport_get"),
)
"""Functions whose results the stubs do not know."""
_ALIAS = re.compile(r"^type (\w+) = ", re.MULTILINE)


def without_pep_695(stub: str) -> str:
    """Write type parameters as type variables of the stub's module, and type statements as assignments."""
    names: set[str] = set()

    def declared(parameters: str) -> str:
        found = re.findall(r"_GenericType\d+", parameters)  # without their bounds
        names.update(found)
        return ", ".join(found)

    def generic_class(match: re.Match[str]) -> str:
        bases = f"{match[3]}, " if match[3] else ""
        return f"class {match[1]}({bases}typing.Generic[{declared(match[2])}]):"

    def generic_function(match: re.Match[str]) -> str:
        declared(match[2])
        return f"{match[1]}("

    stub = _GENERIC_FUNCTION.sub(generic_function, _GENERIC_CLASS.sub(generic_class, stub))
    stub = _ALIAS.sub(r"\1: typing.TypeAlias = ", stub)
    variables = "".join(f'{name} = typing.TypeVar("{name}")\n' for name in sorted(names))
    return stub.replace("import typing\n", f"import typing\n{variables}", 1) if names else stub


def with_missing(stub: str) -> str:
    """Declare what the stubs leave out: properties of the add-on, custom properties, subtypes, results, numbers."""
    anything = "    def __getattr__(self, name: str) -> typing.Any: ...\n"
    settable = anything + "    def __setattr__(self, name: str, value: typing.Any) -> None: ...\n"
    members = {
        "Scene": "    kfmocap: typing.Any\n    kfmocap_capture: typing.Any\n",
        "PropertyGroup": settable,
        "Space": settable,
        "ActionStrip": anything,
        "Property": anything,
        "bpy_struct": "    def __contains__(self, key: str) -> bool: ...\n",
    }
    for name, lines in members.items():
        stub = re.sub(rf"^class {name}(\(.*\))?:\n", rf"\g<0>{lines}", stub, flags=re.MULTILINE)
    for name in ("data", "id_data", "pixels"):
        stub = re.sub(rf"^    def {name}\(self\) -> .*:", rf"    def {name}(self) -> typing.Any:", stub, flags=re.M)
        stub = re.sub(rf"^    {name}: (\(\n(.*\n)*?    \)|.*)", f"    {name}: typing.Any", stub, flags=re.M)
    for name in _RESULTS:
        stub = re.sub(rf"(def {name}\((?:[^()]|\([^()]*\))*\)) -> [^:]*:", r"\1 -> typing.Any:", stub)
    # Blender takes NumPy's arrays for its vectors, and any text for an icon's name.
    stub = stub.replace("collections.abc.Sequence[float] | mathutils.Vector", "typing.Any")
    return re.sub(r"^(IconItems: typing.TypeAlias) = typing.Literal\[[^\]]*\]", r"\1 = str", stub, flags=re.M)


def main() -> None:
    """Copy the stubs of the modules that the add-on imports, and of those that these refer to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    shutil.rmtree(folder, ignore_errors=True)
    for module in MODULES:
        source = Path(sysconfig.get_path("purelib")) / f"{module}-stubs"
        for file in source.rglob("*.pyi"):
            target = folder / module / file.relative_to(source)
            target.parent.mkdir(parents=True, exist_ok=True)
            stub = with_missing(without_pep_695(file.read_text(encoding="utf-8")))
            target.write_text(stub, encoding="utf-8")
    with (folder / "bpy" / "ops" / "__init__.pyi").open("a", encoding="utf-8") as operators:
        operators.write("\nimport typing\n\nkfmocap: typing.Any\n")


if __name__ == "__main__":
    main()
