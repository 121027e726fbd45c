"""What a command replaces: what it wrote before, and nothing else."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rehyb.errors import Invalid
from rehyb.own_files import check_own
from tests.testbed.coordinators.finished_study import FinishedStudy

Run = Callable[..., tuple[int, str, str]]
WRITERS = (
    "study export s1",
    "study export s1 --format parquet",
    "study export s1 --format netcdf",
    "study results s1",
    "bundle s1",
    "report s1",
)


@pytest.mark.parametrize("command", WRITERS)
def test_a_command_replaces_what_it_wrote_and_no_other_file(
    command: str, run: Run, talk_to: Callable[[FinishedStudy], None], tmp_path: Path
) -> None:
    talk_to(FinishedStudy())
    mine = tmp_path / "mine"
    mine.write_text("time,torque\n0,1\n")
    status, out, err = run(*command.split(), "--out", str(mine))
    assert (status, out) == (2, "")
    assert err == (
        f"rehyb: {mine} is there already, and not as this command writes it: name another file, "
        "or remove it\n"
    )
    assert mine.read_text() == "time,torque\n0,1\n"
    again = tmp_path / "again"
    for _ in range(2):
        assert run(*command.split(), "--out", str(again))[0] == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "mine"]


@pytest.mark.parametrize(
    "command",
    [
        "study with-effect nothere.json --out {}/model.toml",
        "study of-session nothere nothere --out {}",
    ],
)
def test_what_may_have_been_changed_by_hand_is_said_to_be_never_written_over(
    command: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "model.toml").write_text("")
    monkeypatch.setattr("rehyb.cli.close_loop.effect_study", lambda *_, **__: {})
    status, out, err = run(*command.format(tmp_path).split())
    assert (status, out) == (2, "")
    assert err == (
        f"rehyb: {tmp_path}/model.toml is there already, and may have been changed by hand, so it "
        "is never written over: name another file, or remove it\n"
    )


def test_a_report_goes_neither_into_a_sessions_folder_nor_over_files_that_are_no_report(
    run: Run, tmp_path: Path
) -> None:
    session, other, earlier = (tmp_path / name for name in ("session", "other", "earlier"))
    for folder in (session, other, earlier):
        folder.mkdir()
    (session / "session.json").write_text("{}")
    (other / "residuals.csv").write_text("mine")
    status, _, err = run("close-loop", str(session), "--out", str(session))
    assert status == 2 and f"{session} is the folder of a session: name another" in err
    status, _, err = run("close-loop", str(session), "--out", str(other))
    assert status == 2 and f"{other / 'residuals.csv'} is there already" in err
    # Where there is an earlier one, what is wrong is the session.
    (earlier / "report.json").write_text(json.dumps({"verdict": "none", "effects": []}))
    status, _, err = run("close-loop", str(session), "--out", str(earlier))
    assert status == 2 and "is there already" not in err
    assert (other / "residuals.csv").read_text() == "mine"


@pytest.mark.parametrize("kind", ["picture", "film", "record", "bank", "instance", "draft"])
def test_nothing_of_the_users_is_taken_for_what_a_command_wrote(kind: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    check_own(mine, kind)
    for content in (b"", b"{}", b"\x89PNG\r\n\x1a\nmine", b"PK", b"[1, 2]"):
        mine.write_bytes(content)
        with pytest.raises(Invalid, match="is there already"):
            check_own(mine, kind)


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_a_picture_is_drawn_again(ending: str, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    Figure().savefig(tmp_path / f"a.{ending}")
    check_own(tmp_path / f"a.{ending}", "picture")
