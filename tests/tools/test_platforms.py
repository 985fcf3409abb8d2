"""What can be checked anywhere of Windows and macOS: names in the zips, wheels for each platform, calls of the code."""

from __future__ import annotations

import ast
import re
import zipfile
from collections.abc import Sequence
from itertools import product
from pathlib import PurePosixPath

import build_extension
import pytest
from conftest import ROOT, nodes

SOURCES = [ROOT / "__init__.py"]
SOURCES += sorted(path for part in ("cli", "core", "kfmocap_addon") for path in (ROOT / part).rglob("*.py"))
LOCKED = list(build_extension.read_lock())

RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port, n in product(("com", "lpt"), range(10)))}
LONGEST_PATH = 259
"""Characters on Windows, where long paths are not enabled."""
HOME = r"C:\Users\twenty-characters-xx\AppData\Roaming\Blender Foundation\Blender\5.2\extensions"
POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty", "posix"}
WINDOWS_MODULES = {"msvcrt", "winreg", "winsound", "_winapi"}
POSIX_CALLS = {
    "os": {
        *("chown", "chroot", "fchmod", "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getgroups"),
        *("getloadavg", "getpgid", "getpgrp", "getpriority", "getsid", "getuid", "killpg", "lchown", "mkfifo", "mknod"),
        *("nice", "openpty", "pipe2", "posix_fadvise", "posix_spawn", "pread", "pwrite", "sched_getaffinity"),
        *("sched_setaffinity", "sendfile", "setpriority", "setsid", "setuid", "statvfs", "sync", "sysconf", "uname"),
        *("wait", "wait3", "wait4", "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "O_SYNC"),
    },
    "signal": {
        "SIGALRM",
        "SIGCHLD",
        "SIGHUP",
        "SIGKILL",
        "SIGPIPE",
        "SIGQUIT",
        "SIGTSTP",
        "SIGUSR1",
        "SIGUSR2",
        "alarm",
    },
    "time": {"tzset"},
}
ASKED = re.compile(r"sys\.platform|os\.name|hasattr\(|getattr\(")
"""A function with one of these asks where it runs before it calls what is not everywhere."""


def packed_names() -> list[str]:
    """Names in the zips as the manifest packs them, with all wheels."""
    return [path.relative_to(ROOT).as_posix() for path in SOURCES] + [f"wheels/{name}" for name in LOCKED]


def unpacked_names() -> list[str]:
    """Names in those wheels that were downloaded; Blender puts them beside the extensions."""
    found = []
    for wheel in (build_extension.CACHE / name for name in LOCKED):
        if wheel.is_file():
            with zipfile.ZipFile(wheel) as archive:
                found += archive.namelist()
    return found


def odd(names: list[str]) -> list[str]:
    """Names that Windows does not take as they are."""
    found = []
    for name in names:
        for part in PurePosixPath(name).parts:
            forbidden = re.search(r'[<>:"|?*\\\x00-\x1f]|[ .]$', part) or not part.isascii()
            if forbidden or part.split(".")[0].lower() in RESERVED:
                found.append(name)
    return found


def test_windows_takes_every_name_in_the_zips() -> None:
    assert odd(packed_names()) == []
    assert odd(["core/aux.py", "core/a:b.py", "core/end.", "core/\u00e4.py"]) != []


def test_no_two_names_differ_in_case_alone() -> None:
    names = packed_names()
    assert len({name.lower() for name in names}) == len(names)


def test_paths_are_short_enough_for_windows() -> None:
    own = [rf"{HOME}\user_default\kfmocap\{name}" for name in packed_names()]
    wheels = [rf"{HOME}\.local\lib\python3.13\site-packages\{name}" for name in unpacked_names()]
    assert [path for path in own + wheels if len(path) > LONGEST_PATH] == []


@pytest.mark.parametrize(("platform", "python"), product(build_extension.PLATFORMS, build_extension.PYTHONS))
def test_every_platform_has_one_wheel_of_every_library_for_each_python(platform: str, python: str) -> None:
    here = []
    for name in LOCKED:
        library, _, tag, abi, _ = name.removesuffix(".whl").split("-")
        version = int(python.replace(".", ""))
        fits = tag in ("py3", f"cp{version}") or (abi == "abi3" and int(tag[2:]) <= version)
        if build_extension.platform_of(name) in (platform, None) and fits:
            here.append(library.replace("_", "-"))
    assert sorted(here) == sorted(line.split("==")[0] for line in build_extension.requirements())


def test_the_oldest_macos_that_the_wheels_run_on_is_said() -> None:
    tags = [re.search(r"macosx_(\d+)_", name) for name in LOCKED]
    newest = max(int(tag[1]) for tag in tags if tag)
    assert f"macOS {newest}" in (ROOT / "README.md").read_text(encoding="utf-8")


def uses(tree: Sequence[ast.AST]) -> list[tuple[str, ast.AST]]:
    """What of some nodes is not on every platform: names of modules and calls, each with the node that uses it."""
    found: list[tuple[str, ast.AST]] = []
    for node in tree:
        if isinstance(node, ast.Import):
            found += [(a.name, node) for a in node.names if a.name in POSIX_MODULES | WINDOWS_MODULES]
        elif isinstance(node, ast.ImportFrom) and node.module in POSIX_MODULES | WINDOWS_MODULES:
            found.append((str(node.module), node))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            missing = POSIX_CALLS.get(node.value.id, set())
            found += [(f"{node.value.id}.{node.attr}", node)] if node.attr in missing else []
    return found


def unguarded(source: str, tree: Sequence[ast.AST] = ()) -> list[str]:
    """Uses of what is not everywhere outside functions that ask where they run, in a source and its nodes."""
    tree, lines = tree or tuple(ast.walk(ast.parse(source))), source.splitlines()
    if not (used := uses(tree)):
        return []
    asking = [
        function
        for function in tree
        if isinstance(function, ast.FunctionDef)
        and ASKED.search("\n".join(lines[function.lineno - 1 : function.end_lineno]))
    ]
    guarded = {id(node) for function in asking for node in ast.walk(function)}
    return [name for name, node in used if id(node) not in guarded]


def test_calls_that_are_not_everywhere_are_made_where_the_platform_is_asked_for() -> None:
    found = {str(path.relative_to(ROOT)): unguarded(path.read_text(encoding="utf-8"), nodes(path)) for path in SOURCES}
    assert {path: names for path, names in found.items() if names} == {}
    assert unguarded("import os\ndef nicer():\n    os.nice(5)\n") == ["os.nice"]
    assert unguarded("import fcntl\n") == ["fcntl"]
    assert unguarded("import os\ndef nicer():\n    if hasattr(os, 'nice'):\n        os.nice(5)\n") == []


def test_files_are_read_and_written_in_utf_8() -> None:
    """Windows would take its own encoding."""
    wrong = []
    for path in SOURCES:
        calls = [node for node in nodes(path) if isinstance(node, ast.Call)]
        for node in calls:
            method = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            texts = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
            is_text = method in ("read_text", "write_text") or (
                method == "open" and texts and texts[0] in ("r", "w", "a")
            )
            if is_text and not any(keyword.arg == "encoding" for keyword in node.keywords):
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert wrong == []
