"""The job type of Flamenco, compiled as its Manager does."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLAMENCO = ROOT / "rust" / "cli" / "src" / "emit" / "relume_bake.js"
MOCK = """
const vm = require("vm"), fs = require("fs");
const [script, settings] = process.argv.slice(1);
const list = (text) => text.split(",").flatMap((range) => {
    const [first, last] = range.split("-").map(Number);
    return Array.from({ length: (last || first) - first + 1 }, (_, index) => String(first + index));
});
const author = {
    Task: (name, type) => ({
        name, type, commands: [], needs: [],
        addCommand(command) { this.commands.push(command); },
        addDependency(task) { this.needs.push(task.name); },
    }),
    Command: (name, parameters) => ({ name, parameters }),
};
const tasks = [];
const job = { settings: JSON.parse(settings), addTask: (task) => tasks.push(task) };
const frameChunker = (frames, size) => size === 1 ? list(frames) : null;
const manager = vm.createContext({ author, job, frameChunker });
vm.runInContext(fs.readFileSync(script, "utf8") + "; compileJob(job)", manager);
console.log(JSON.stringify({ type: vm.runInContext("JOB_TYPE", manager), tasks }));
"""
"""Flamenco Manager's globals, and a job that is compiled with them."""


def compiled(settings):
    """Type and tasks of a job of Flamenco."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node to run the job type of Flamenco with")
    command = [node, "-e", MOCK, str(FLAMENCO), json.dumps(settings)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_a_job_of_flamenco_plans_in_blender_and_does_each_part_anywhere():
    settings = {"frames": "3,5-6", "parts": 2, "folder": "/shared/job", "relume": "relume", "blendfile": "/a.blend"}
    found = compiled(settings)
    plan, *parts, collect = found["tasks"]
    (command,) = plan["commands"]
    assert (plan["type"], command["name"]) == ("blender", "blender-render")
    assert command["parameters"] == {
        "exe": "{blender}",
        "exeArgs": "{blenderArgs}",
        "argsBefore": [],
        "blendfile": "/a.blend",
        "args": ["--command", "relume", "farm", "--out", "/shared/job", "--frames", "3,5-6", "--parts", "2"],
    }
    assert [part["name"] for part in parts] == [f"part-{number}" for number in range(1, 7)]
    for number, part in enumerate(parts, 1):
        (command,) = part["commands"]
        words = ["work", "/shared/job", "--part", str(number)]
        assert command == {"name": "exec", "parameters": {"exe": "relume", "args": words}}
        assert part["needs"] == ["plan"]
    assert collect["needs"] == [part["name"] for part in parts]
    assert collect["commands"][0]["parameters"] == {"exe": "relume", "args": ["collect", "/shared/job"]}


def test_settings_of_the_job_type_are_those_that_flamenco_knows():
    keys = {"key", "type", "subtype", "required", "default", "eval", "visible", "propargs", "description"}
    settings = compiled({"frames": "1", "parts": 1, "folder": "f", "relume": "r", "blendfile": "b"})["type"]["settings"]
    for setting in settings:
        assert setting.keys() <= keys and setting["type"] in {"string", "int32"}
        compile(setting.get("eval", "None"), setting["key"], "eval")
    assert {setting["key"] for setting in settings} == {"frames", "parts", "folder", "relume", "blendfile"}
