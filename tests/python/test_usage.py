"""The keywords of the functions against ``posing --json-usage``."""

import inspect
import json
import re

import pytest

import posing
from posing._program import ONE_BY_ONE

TABLES = ["c3d2xyz", "trc2xyz", "bvh2xyz", "amc2xyz", "csv2xyz", "trim"]
FILES = ["xyz2c3d", "xyz2trc", "xyz2bvh", "xyz2glb", "xyz2amc", "trim"]
COMMANDS = {
    posing.complete: ["complete"],
    posing.denoise: ["denoise"],
    posing.audit: ["audit"],
    posing.read: TABLES,
    posing.write: FILES,
    posing.label: ["label"],
    posing.clean: ["clean"],
    posing.solve: ["solve"],
    posing.retarget: ["retarget"],
    posing.ground: ["ground"],
    posing.plot: ["plot"],
    posing.align: ["align"],
    posing.score: ["score"],
    posing.forces: ["c3d2forces"],
}


@pytest.fixture(scope="module")
def usage():
    """Flags of each command by their keywords."""
    found = json.loads(posing.run("--json-usage").stdout)
    return {
        command["name"]: {
            a["flag"][2:].replace("-", "_"): a for a in command["arguments"] if a["flag"]
        }
        for command in found["commands"]
    }


def keywords():
    """Every keyword of every function, but those of the package alone."""
    for function, commands in COMMANDS.items():
        for parameter in inspect.signature(function).parameters.values():
            if parameter.kind == parameter.KEYWORD_ONLY and parameter.name != "frame":
                yield function, commands, parameter


def described(function, name):
    """The paragraph of a parameter in the documentation; that of complete where it says so."""
    text = inspect.getdoc(function)
    found = re.search(rf"^{name} : .*\n(?:    .*\n)+", text, re.MULTILINE)
    return found.group() if found else described(posing.complete, name)


@pytest.mark.parametrize("function, commands, parameter", list(keywords()))
def test_a_keyword_is_a_flag(usage, function, commands, parameter):
    flags = [
        usage[command][parameter.name] for command in commands if parameter.name in usage[command]
    ]
    assert flags, f"{parameter.name} is no flag of {commands}"
    for flag in flags:
        assert (flag["type"] == "switch") == (parameter.annotation == "bool")
        assert (flag["type"] == "switch") == (parameter.default is False)
        assert parameter.default in (None, False), "the program has the defaults"
        if flag["type"] == "number":
            assert "float" in parameter.annotation


@pytest.mark.parametrize("function, commands, parameter", list(keywords()))
def test_a_keyword_is_described_as_it_is(usage, function, commands, parameter):
    text = described(function, parameter.name)
    for command in commands:
        flag = usage[command].get(parameter.name)
        if flag and flag["type"] == "choice":
            choices = ", ".join(f'"{choice["name"]}"' for choice in flag["choices"])
            assert f"{{{choices}}}" in text
    if len(commands) == 1 and usage[commands[0]][parameter.name]["default"]:
        assert usage[commands[0]][parameter.name]["default"] in text


def test_a_list_is_joined_by_commas_or_given_one_by_one(usage):
    for command in sum(COMMANDS.values(), []):
        for name, flag in usage[command].items():
            if name != "to":
                assert name in ONE_BY_ONE or flag.get("commas") or not flag["repeats"], name
            if name in ONE_BY_ONE:
                assert flag["repeats"] and not flag.get("commas"), (command, name)


def test_every_function_has_an_example_that_calls_it():
    for name in posing.__all__:
        made = getattr(posing, name)
        if inspect.isfunction(made) and name != "program":
            example = rf"(?s)Examples\n-+\n.*>>>.*posing\.{name}\("
            assert re.search(example, inspect.getdoc(made)), name
