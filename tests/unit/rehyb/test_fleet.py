"""A fleet keeps its token to its owner."""

from pathlib import Path

from rehyb.fleet import LocalFleet


def test_a_token_is_made_once_and_is_for_its_owner_only(tmp_path: Path) -> None:
    first = LocalFleet(tmp_path, workers=1)
    assert len(first.token) >= 32
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
    assert LocalFleet(tmp_path, workers=1).token == first.token


def test_a_given_token_is_used_and_not_written_down(tmp_path: Path) -> None:
    assert LocalFleet(tmp_path, workers=1, token="given").token == "given"
    assert list(tmp_path.iterdir()) == []
