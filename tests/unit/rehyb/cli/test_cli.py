"""The command says in one sentence what is wrong, and by its exit status whose fault it is."""

import json
import socket
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import httpx2
import pytest
import typer

from rehyb.cli.options import read_json

Run = Callable[..., tuple[int, str, str]]

STUDY = {
    "id": "s1",
    "name": "n",
    "model": "ishigami",
    "method": "morris",
    "rows": 5,
    "state": "running",
    "instances": 20,
}


@pytest.fixture
def sent(talk_to: Callable[..., None]) -> list[dict[str, Any]]:
    """A coordinator that takes every study; what it was sent."""
    bodies: list[dict[str, Any]] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            bodies.append(json.loads(request.content))
            return httpx2.Response(201, json=STUDY)
        if request.url.path == "/v1/studies":
            return httpx2.Response(200, json={"studies": [STUDY]})
        return httpx2.Response(404, json={"detail": "there is no study s9: see /v1/studies"})

    talk_to(answer)
    return bodies


def test_bodies_as_they_are_are_a_preset_that_options_win_over(
    run: Run, sent: list[dict[str, Any]]
) -> None:
    status, _, said = run(
        *[
            "study",
            "submit",
            "--preset",
            "anthropometric",
            "--model",
            "elbow_bushing",
            "--rows",
            "7",
        ]
    )
    assert (status, said) == (0, "")
    assert (sent[0]["method"], sent[0]["rows"]) == ("shapley", 7)
    assert ["upper_arm_length", "forearm_length", 0.81] in sent[0]["correlations"]
    status, _, said = run("study", "submit", "--preset", "tall")
    assert status == 2 and "there is no preset 'tall'" in said


def test_a_study_is_submitted_from_options(run: Run, sent: list[dict[str, Any]]) -> None:
    options = "--model ishigami --method morris --rows 5 --factor x1=0:1 --fix x2=0.5 --output y"
    status, out, _ = run("study", "submit", *options.split())
    assert (status, out) == (0, "s1  n: 20 instances\n")
    assert sent == [
        {
            "name": "ishigami morris 5",
            "model": "ishigami",
            "method": "morris",
            "rows": 5,
            "factors": [{"name": "x1", "range": [0.0, 1.0]}],
            "fixed": {"x2": 0.5},
            "outputs": ["y"],
        }
    ]


def test_options_win_over_a_study_file(
    run: Run, sent: list[dict[str, Any]], tmp_path: Path
) -> None:
    file = tmp_path / "study.json"
    study = {"name": "n", "model": "ishigami", "method": "morris", "rows": 5}
    file.write_text(json.dumps(study))
    status, out, _ = run("study", "submit", str(file), "--rows", "7", "--json")
    assert (status, json.loads(out)) == (0, STUDY)
    assert sent == [{**study, "rows": 7}]


def test_a_list_is_a_table_or_json(run: Run, sent: list[dict[str, Any]]) -> None:
    assert "ishigami" in run("study", "list")[1]
    assert json.loads(run("study", "list", "--json")[1]) == {"studies": [STUDY]}


def test_what_the_coordinator_does_not_know_fails_in_its_words(
    run: Run, sent: list[dict[str, Any]]
) -> None:
    status, out, err = run("study", "show", "s9")
    assert (status, out, err) == (1, "", "rehyb: there is no study s9: see /v1/studies\n")


def test_a_coordinator_that_is_not_there_fails_with_what_to_do(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_URL", "http://127.0.0.1:9")
    status, _, err = run("study", "list")
    assert status == 1
    assert "rehyb up" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("study submit --rows 5", "a study needs model, method: give --model --method, or a FILE"),
        ("study submit no-such-file.json", "no-such-file.json cannot be read: No such file"),
        ("study submit --factor x1", "'x1' is not of the form NAME=LOW:HIGH, as in x1=0.5:1.5"),
        ("study submit --factor m=3", "'m=3' is not of the form NAME=LOW:HIGH, as in m=0.5:1.5"),
        ("study submit --factor =0:1", "'=0:1' is not of the form NAME=LOW:HIGH, as in x1=0."),
        ("study submit --fix x1=much", "x1 must be a number, not 'much'"),
        ("study submit --fix x1=nan", "x1 must be a finite number, not 'nan'"),
        ("study submit --fix x1=1e999", "x1 must be a finite number, not '1e999'"),
        ("study submit --factor x1=0:inf", "the upper end of x1 must be a finite number, not"),
        ("study submit --target nan --up-to 9", "--target is a positive half width of an interval"),
        ("study watch s1 --target nan --up-to 9", "--target is a positive half width of an"),
        ("campaign run --directory d --preset huge", "no preset 'huge': take demo or paper"),
        ("campaign run --directory d --output z", "elbow has no output 'z': it has stiffness_err"),
        ("campaign run --directory d --sampling zork", "no sampling 'zork': take one of owen_blo"),
        (
            "campaign run --directory d --up-to 8 --variance-rows 32",
            "phase 2 begins with 32 rows, and --up-to 8 allows fewer",
        ),
        (
            "campaign run --directory d --local-workers 1 --model nope",
            "there is no model 'nope': take one of elbow, elbow_bushing,",
        ),
        ("study submit --target 1", "--target needs --up-to, the rows that it may cost in all"),
        ("study watch s1 --target 1", "--target and --output need --up-to, the rows that it may"),
        (
            "campaign run --directory d --up-to 64 --target 1.5",
            "--target must be below 0.5, not 1.5: a share of the variance lies between 0 and 1",
        ),
        ("study indices s1 --target 0", "--target is a positive half width of an interval, not"),
        ("assess --set leg_length=1", "an assessment has no factor 'leg_length': it has upper_arm"),
        ("assess --set refitted_muscles=0", "write muscles=paper for refitted_muscles=0, and"),
        ("assess --set muscles=mine", "muscles must be paper, holzbaur2005 or physiological, not"),
        ("assess --set forearm_mass=1 --set forearm_mass=2", "forearm_mass is set twice, to 1 and"),
        ("assess --set forearm_mass=heavy", "forearm_mass must be a number, not 'heavy'"),
        ("assess --set forearm_mass=10", "far outside 0.1 to 1.82, for which the model was"),
        ("assess --set upper_arm_elasticity=1", "take 50.25 to 1848.36, or ask for it with"),
        (
            "assess --set forearm_mass=-1 --outside-range",
            "factor forearm_mass must be positive and finite",
        ),
        ("assess --replay no-such.json", "no-such.json cannot be read: No such file"),
        ("study extend s1", "Missing option '--rows'"),
        ("study", "Usage"),
        ("no-such-command", "No such command"),
    ],
)
def test_wrong_use_has_status_2_and_says_what_would_be_right_before_a_token_is_needed(
    run: Run, monkeypatch: pytest.MonkeyPatch, command: str, words: str
) -> None:
    monkeypatch.delenv("REHYB_TOKEN")
    status, out, err = run(*command.split())
    assert status == 2
    assert words in out + err
    assert "Traceback" not in err


def test_a_file_that_cannot_be_written_is_one_sentence(
    run: Run, sent: list[dict[str, Any]], tmp_path: Path
) -> None:
    status, _, err = run("study", "results", "s1", "--out", str(tmp_path / "no" / "r.csv"))
    assert status == 2
    assert err.endswith("/r.csv: No such file or directory\n")
    assert len(err.splitlines()) == 1


def test_a_coordinator_without_a_token_is_not_started(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("REHYB_TOKEN")
    status, _, err = run("coordinator")
    assert status == 2
    assert err.startswith("rehyb: REHYB_TOKEN: ")
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("command", ["db upgrade", "db check", "db backup copy", "token list"])
def test_a_database_that_cannot_be_opened_is_one_sentence_that_names_its_file(
    run: Run, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.sqlite3").mkdir()
    monkeypatch.setenv("REHYB_DATABASE_URL", "sqlite:///a.sqlite3")
    status, _, err = run(*command.split())
    assert (status, err) == (
        2,
        f"rehyb: the database cannot be used: {tmp_path}/a.sqlite3: is a folder; name a file\n",
    )


def test_of_a_copy_the_database_that_cannot_be_opened_is_named(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{tmp_path / 'a.sqlite3'}")
    run("db", "upgrade")
    status, _, err = run("db", "copy", f"sqlite:///{tmp_path}/none/b")
    assert status == 2
    assert f"cannot be used: {tmp_path}/none/b: there is no folder {tmp_path}/none\n" in err


@pytest.mark.parametrize("url", ["sqlite://", "sqlite:///:memory:"])
@pytest.mark.parametrize("command", ["coordinator", "db upgrade", "db copy sqlite:///b"])
def test_a_database_without_a_file_is_one_sentence_and_leaves_none(
    run: Run, command: str, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("REHYB_DATABASE_URL", url)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    status, _, err = run(*command.split())
    assert status == 2 and len(err.splitlines()) == 1
    assert "no file" in err or "there is no database" in err
    assert not list(tmp_path.iterdir())


def test_a_copy_into_no_file_is_one_sentence(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{tmp_path / 'a.sqlite3'}")
    run("db", "upgrade")
    status, _, err = run("db", "copy", "sqlite://")
    assert status == 2
    assert err.startswith("rehyb: the database's URL names no file") and err.count("\n") == 1


@pytest.mark.parametrize("place", ["nowhere/copy.sqlite3", "file/copy.sqlite3"])
def test_a_backup_that_cannot_be_written_is_one_sentence_with_its_place(
    run: Run, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REHYB_DATABASE_URL", f"sqlite:///{tmp_path / 'a.sqlite3'}")
    run("db", "upgrade")
    (tmp_path / "file").touch()
    status, _, err = run("db", "backup", str(tmp_path / place))
    assert status == 2 and len(err.splitlines()) == 1
    assert err.startswith(f"rehyb: the copy {tmp_path / place} cannot be written (")
    assert "name a file in a folder that is there" in err


@pytest.mark.parametrize(
    "command",
    [
        "db check",
        "db backup copy.sqlite3",
        "db restore copy.sqlite3",
        "db copy sqlite:///b",
        "token create anna --scope read",
        "token list",
        "token revoke abc",
    ],
)
def test_no_empty_database_is_made_beside_the_one_that_was_meant(
    run: Run, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In another folder than that of `rehyb up`: a token that no coordinator knows, say."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("REHYB_DATABASE_URL", raising=False)
    status, _, err = run(*command.split())
    assert status == 2 and "there is no database" in err and ".rehyb/rehyb.sqlite3" in err
    assert not list(tmp_path.glob("*.sqlite3"))


def test_every_command_explains_itself_and_has_a_json_form(run: Run) -> None:
    for command in (
        "study submit",
        "study list",
        "study show",
        "study progress",
        "study indices",
        "study cancel",
        "study results",
        "study surrogate",
        "report",
        "study pause",
        "study resume",
        "study extend",
        "study priority",
        "study rerun",
        "study failures",
        "study instance",
        "study delete",
        "workers",
        "campaign run",
        "assess",
        "validate",
        "up",
        "db upgrade",
        "db backup",
        "db restore",
        "db copy",
        "db check",
        "token create",
        "token list",
        "token revoke",
    ):
        status, out, _ = run(*command.split(), "--help")
        assert status == 0, command
        assert "--json" in out, command


def test_the_version_is_said(run: Run) -> None:
    status, out, _ = run("--version")
    assert (status, out) == (0, f"rehyb {metadata.version('rehyb')}\n")


def test_a_key_that_comes_twice_in_a_file_is_named(tmp_path: Path) -> None:
    """As by REST: the last one was taken without a word."""
    (tmp_path / "study.json").write_text('{"factors": [{"name": "x1", "low": 0, "low": 1}]}')
    with pytest.raises(typer.BadParameter, match=r"study\.json: the key 'low' comes twice"):
        read_json(str(tmp_path / "study.json"))


def test_json_nested_without_end_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(typer.BadParameter, match=r"deep\.json is nested too deeply"):
        read_json(str(tmp_path / "deep.json"))


def test_a_port_that_somebody_has_is_named_with_what_to_do(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        asked = (
            "umbridge",
            "serve",
            "--model",
            "ishigami",
            "--processes",
            "1",
            "--port",
            str(port),
        )
        status, _, said = run(*asked)
    assert status == 1
    assert said == (
        f"rehyb: nobody can listen on port {port} of 127.0.0.1 (Address already in use): stop what "
        "listens there, or give another --port (0: any that is free) or --host\n"
    )
