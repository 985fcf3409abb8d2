"""The templates for render farms call commands that the program has, one task a shot and the table after them all."""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from kfmocap.cli.arguments import parser

FARM = Path(__file__).parents[2] / "examples" / "farm"
STAND_IN = """
const author = {
  Task: (name, type) => ({
    name, type, commands: [], dependencies: [],
    addCommand(command) { this.commands.push(command); },
    addDependency(task) { this.dependencies.push(task.name); },
  }),
  Command: (name, parameters) => ({ name, ...parameters }),
};
const tasks = [];
"""


def parsed(arguments: list[str]) -> argparse.Namespace:
    """The arguments as the program reads them; it would end with a usage message if it could not."""
    return parser().parse_args(arguments)


def openjd() -> dict[str, Any]:
    return json.loads((FARM / "openjd.json").read_text(encoding="utf-8"))


def openjd_arguments(step: dict[str, Any], values: dict[str, str]) -> list[str]:
    """Those of a step with its parameters put in; one that is not defined is an error."""
    action = step["script"]["actions"]["onRun"]
    assert action["command"] == "{{Param.Command}}"
    return [re.sub(r"\{\{(.*?)\}\}", lambda name: values[name[1]], text) for text in action["args"]]


def test_the_openjd_template_tracks_one_shot_a_task_and_then_writes_the_table() -> None:
    template = openjd()
    values = {f"Param.{each['name']}": each["default"] for each in template["parameterDefinitions"]}
    track, summary = template["steps"]
    [shot] = track["parameterSpace"]["taskParameterDefinitions"]
    assert shot["range"] == "{{Param.Tasks}}"
    tracked = parsed(openjd_arguments(track, values | {f"Task.Param.{shot['name']}": "7"}))
    assert (tracked.command, tracked.shots, tracked.task, tracked.jobs) == ("batch", ["./shots/*.toml"], 7, 1)
    assert summary["dependencies"] == [{"dependsOn": track["name"]}]
    summed = parsed(openjd_arguments(summary, values))
    assert summed.summary
    assert summed.out == tracked.out == Path("results")


def test_the_openjd_template_is_valid() -> None:
    model = pytest.importorskip("openjd.model", reason="pip install openjd-cli")
    model.decode_job_template(template=openjd())


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")
@pytest.mark.parametrize("blender_files", [False, True])
def test_the_flamenco_job_has_a_task_for_every_shot_and_one_after_them(blender_files: bool) -> None:
    settings = {"shots": "shots/a.toml, shots/b.toml,", "out": "results", "command": "{kfmocap}"}
    job = json.dumps({"settings": settings | {"blender_files": blender_files}})
    code = (FARM / "flamenco_kfmocap.js").read_text(encoding="utf-8")
    code += f"compileJob({{ ...{job}, addTask: (task) => tasks.push(task) }});"
    code += "console.log(JSON.stringify({ tasks, keys: JOB_TYPE.settings.map((s) => s.key) }));"
    ran = subprocess.run(["node", "-e", STAND_IN + code], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    compiled = json.loads(ran.stdout)
    assert set(compiled["keys"]) == {*settings, "blender_files"}
    *shots, summary = compiled["tasks"]
    assert [task["name"] for task in shots] == ["a.toml", "b.toml"]
    assert summary["dependencies"] == ["a.toml", "b.toml"]
    for task, files in zip(compiled["tasks"], [["shots/a.toml"], ["shots/b.toml"], ["shots/a.toml"]], strict=True):
        [command] = task["commands"]
        assert (command["name"], command["exe"], task["type"]) == ("exec", "{kfmocap}", "misc")
        arguments = parsed(command["args"])
        assert (arguments.shots, arguments.out) == (files, Path("results"))
        assert arguments.summary == (task is summary)
        assert arguments.no_blender != blender_files


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs a shell")
def test_a_task_of_the_slurm_array_tracks_the_shot_of_its_number() -> None:
    environment = os.environ | {"KFMOCAP": "echo", "SLURM_ARRAY_TASK_ID": "3"}
    command = ["bash", str(FARM / "slurm_array.sh"), "shots/*.toml", "results"]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    arguments = parsed(ran.stdout.split())
    assert (arguments.command, arguments.task, arguments.out) == ("batch", 3, Path("results"))
    assert arguments.shots == ["shots/*.toml"]
