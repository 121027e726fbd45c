"""A worker that is given many models says which of them is wrong, and takes the others."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from models.running.places import NoModelError, Places
from tests.testbed.models import EXAMPLES

WRONG = "[model]\nname = 'wrong'\nkind = command\n"


@pytest.fixture
def having(tmp_path: Path) -> Callable[..., Places]:
    """Have models from folders, and be told of what is left out."""

    def having(*folders: Path, left_out: Any = None) -> Places:
        places = Places(fetch=lambda version, path: None, cache=tmp_path / "cache")
        places.have(folders, (), (), left_out)
        return places

    return having


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """A folder of one model that is right and one whose third line is wrong."""
    shutil.copytree(EXAMPLES / "pendulum", tmp_path / "fleet" / "pendulum")
    (tmp_path / "fleet" / "bent").mkdir()
    (tmp_path / "fleet" / "bent" / "model.toml").write_text(WRONG)
    return tmp_path / "fleet"


def test_of_many_models_the_faulty_one_is_named_by_file_and_line_and_the_others_are_had(
    having: Callable[..., Places], fleet: Path
) -> None:
    said: list[str] = []
    places = having(fleet, left_out=said.append)
    assert [one.name for one in places.descriptions.values()] == ["pendulum"]
    assert len(said) == 1
    assert said[0].startswith(f"{fleet}/bent/model.toml: is not TOML: ")
    assert "at line 3" in said[0]


def test_a_model_called_as_one_of_rehybs_own_is_left_out_as_well(
    having: Callable[..., Places], fleet: Path
) -> None:
    said: list[str] = []
    toml = (fleet / "pendulum" / "model.toml").read_text()
    (fleet / "bent" / "model.toml").write_text(toml.replace('"pendulum"', '"elbow"', 1))
    having(fleet, left_out=said.append)
    assert said == [
        f"{fleet}/bent/model.toml: elbow is a model of rehyb's own: choose another name"
    ]


def test_without_a_model_that_can_be_used_its_fault_is_the_error(
    having: Callable[..., Places], fleet: Path
) -> None:
    with pytest.raises(NoModelError, match=r"bent/model\.toml: is not TOML"):
        having(fleet / "bent", left_out=pytest.fail)
    with pytest.raises(NoModelError, match=r"bent/model\.toml: is not TOML"):
        having(fleet)


def test_where_every_model_is_faulty_each_is_named_with_its_own_fault(
    having: Callable[..., Places], fleet: Path
) -> None:
    shutil.rmtree(fleet / "pendulum")
    (fleet / "empty").mkdir()
    (fleet / "empty" / "model.toml").write_text("")
    with pytest.raises(NoModelError) as error:
        having(fleet, left_out=pytest.fail)
    first, second = str(error.value).split("; ", 1)
    assert first.startswith(f"{fleet}/bent/model.toml: is not TOML: ")
    assert second.startswith(f"{fleet}/empty/model.toml: ")


def test_of_a_hundred_faulty_models_five_are_named_and_the_others_counted(
    having: Callable[..., Places], fleet: Path
) -> None:
    shutil.rmtree(fleet / "pendulum")
    for number in range(99):
        shutil.copytree(fleet / "bent", fleet / f"bent{number:02}")
    with pytest.raises(NoModelError) as error:
        having(fleet, left_out=pytest.fail)
    assert str(error.value).count("is not TOML") == 5
    assert str(error.value).endswith("; and 95 more")


def test_a_path_without_any_model_is_the_error_whatever_else_is_named(
    having: Callable[..., Places], fleet: Path
) -> None:
    with pytest.raises(NoModelError, match=r"there is no such file in .*nor in a folder in it"):
        having(fleet / "pendulum", fleet / "pendulum" / "inner", left_out=pytest.fail)
