"""A worker that is given many models says which of them is wrong."""

from pathlib import Path

import pytest

from models.folder import ModelError
from models.running.places import folders_in


def test_of_many_models_the_faulty_one_is_named_by_its_folder(tmp_path: Path) -> None:
    for name in ("good", "turned"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.toml").write_text("[model]\nkind = 'nothing'\n")
    with pytest.raises(ModelError, match=r"good/model\.toml: model\.kind is 'nothing'"):
        list(folders_in([tmp_path]))
    with pytest.raises(ModelError, match="there is no such file in"):
        list(folders_in([tmp_path / "good" / "inner"]))
