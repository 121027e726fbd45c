"""`rehyb model check` tells what a newcomer's model lacks before any worker refuses it."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.testbed.command import run as run
from tests.testbed.models import edited

Run = Callable[..., tuple[int, str, str]]

#: A program of one point at a time, with a space in its path.
TOML = """
[model]
name = "mine"
kind = "command"
[[factors]]
name = "x"
unit = "1"
low = 0.0
high = 1.0
nominal = 0.5
[[outputs]]
name = "y"
unit = "1"
[command]
run = ["python3", "my model.py"]
"""
HEAD = "import json, random, sys\nasked = json.loads(input())\nx = asked['parameters']['x']\n"


def model(scratch: Path, program: str) -> Path:
    folder = scratch / "a folder"
    folder.mkdir()
    (folder / "model.toml").write_text(TOML)
    (folder / "my model.py").write_text(HEAD + program)
    return folder


@pytest.mark.parametrize("noise", ["random.random()", "asked['seed']"])
def test_a_model_with_noise_is_told_so_unless_it_says_so_itself(
    run: Run, noise: str, tmp_path: Path
) -> None:
    folder = model(tmp_path, f"print(json.dumps({{'outputs': {{'y': x + {noise}}}}}))")
    status, out, _ = run("model", "check", str(folder))
    assert status == 1 and ": command, 1 factor\n" in out
    assert "it gives other numbers at the same point" in out and "next:" not in out
    assert "says `deterministic = false`" in " ".join(out.split())
    text = (folder / "model.toml").read_text()
    (folder / "model.toml").write_text(text.replace("[model]", "[model]\ndeterministic = false"))
    assert run("model", "check", str(folder))[0] == 0


def test_a_model_without_noise_is_looked_at_twice_and_may_be_added(
    run: Run, tmp_path: Path
) -> None:
    status, out, _ = run("model", "check", str(edited("pendulum", tmp_path)), "--json")
    said = json.loads(out)
    first, *_, again = said["evaluations"]
    assert (status, said["failed"], said["faults"]) == (0, 0, [])
    assert first["outputs"] == again["outputs"] and again["where"] == "again, another seed"


#: A program that stays, and adds what it was asked before.
KEPT = """
last = 0.0
while True:
    print(json.dumps({'outputs': {'y': x + last}}), flush=True)
    last, x = x, json.loads(input())['parameters']['x']
"""


def test_a_program_that_remembers_other_points_is_told_so(run: Run, tmp_path: Path) -> None:
    folder = model(tmp_path, KEPT)
    (folder / "model.toml").write_text(TOML + "keep = true\n")
    status, out, _ = run("model", "check", str(folder))
    assert status == 1 and "it gives other numbers at the same point" in out


#: What people do wrong, and what they are told.
MISTAKES = {
    "print('starting'); print('{\"outputs\": {\"y\": 1}}')": "'starting' besides its answer",
    'print(\'{"outputs": {"Y": 1}}\')': "output 'Y' is not in its description",
    "print('{\"y\": 1}')": "an object of 'y'",
    "print(json.dumps({'outputs': {'y': float('nan')}}))": "y came out as nan",
    "raise ValueError('no such muscle')": "it said last: ValueError: no such muscle",
    "print(x)": "must print {",
    "pass": "before it answered: it must print one line of JSON",
    r"print(json.dumps({'outcome': 'odd', 'reason': 'a\u202eb'}))": r"odd: a\u202eb",
}


@pytest.mark.parametrize("program", MISTAKES)
def test_a_mistake_is_told_where_the_model_is_checked(
    run: Run, program: str, tmp_path: Path
) -> None:
    status, out, _ = run("model", "check", str(model(tmp_path, program)))
    assert status == 1 and MISTAKES[program] in out


def test_what_is_named_wrong_is_told_in_a_sentence(run: Run, tmp_path: Path) -> None:
    folder = model(tmp_path, "pass")
    said = "--umbridge is for a model of kind umbridge: this is one of command"
    assert run("model", "check", str(folder), "--umbridge", "http://h")[::2] == (
        2,
        f"rehyb: {said}\n",
    )
    said = f"model.toml: {folder}/model.toml is a file: name the folder that it is in"
    assert run("model", "check", str(folder / "model.toml"))[::2] == (2, f"rehyb: {said}\n")
    (folder / "model.toml").write_text(TOML.replace('"mine"', '"elbow"'))
    said = "model.toml: model.name: elbow is a model of rehyb's own: choose another name"
    assert run("model", "check", str(folder))[::2] == (2, f"rehyb: {said}\n")
    (folder / "model.toml").write_text(TOML.replace("[model]", '[model]\nunits = "SI"'))
    status, _, err = run("model", "check", str(folder))
    assert status == 2 and "model.units is unknown: expected name, kind, description" in err


def test_a_server_that_is_not_there_is_told_before_anything_is_evaluated(
    run: Run, tmp_path: Path
) -> None:
    folder = model(tmp_path, "pass")
    umbridge = TOML.replace("command", "umbridge").partition("run = ")[0]
    (folder / "model.toml").write_text(umbridge)
    nowhere = "http://127.0.0.1:1"
    status, out, err = run("model", "check", str(folder), "--umbridge", nowhere)
    assert (status, out) == (2, "")
    assert (
        err.startswith(f"rehyb: {nowhere}: no UM-Bridge server answers: ") and err.count("\n") == 1
    )
    said = "rehyb: a model of kind umbridge needs its server: --umbridge URL\n"
    assert run("model", "check", str(folder)) == (2, "", said)


def test_what_to_do_next_can_be_typed_as_it_stands(run: Run, tmp_path: Path) -> None:
    folder = model(tmp_path, "print(json.dumps({'outputs': {'y': x}}))")
    _, out, _ = run("model", "check", str(folder))
    assert f"next: rehyb model add '{folder}', then rehyb study submit --model mine --method" in out


def test_an_output_that_nothing_moves_is_named(run: Run, tmp_path: Path) -> None:
    _, out, _ = run("model", "check", str(model(tmp_path, 'print(\'{"outputs": {"y": 0}}\')')))
    assert "y is the same at every point: nothing here moves it" in out


def test_of_a_folder_of_models_it_says_which_is_wrong_and_how_to_look_at_one(
    run: Run, tmp_path: Path
) -> None:
    model(tmp_path, "")
    (tmp_path / "bent").mkdir()
    (tmp_path / "bent" / "model.toml").write_text("[model]\nname = mine\n")
    status, _, said = run("model", "check", str(tmp_path))
    assert status == 2
    assert f"{tmp_path} holds 2 models: name one of them, as {tmp_path}/a folder; " in said
    assert f"{tmp_path}/bent/model.toml: is not TOML: Invalid value (at line 2, column 8)" in said
