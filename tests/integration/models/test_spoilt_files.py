"""Whatever a model's files hold, it is read or refused with a sentence: `make soak` goes on."""

from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.folder import ModelError, read_folder
from models.mjcf.simulate import Simulation
from tests.testbed import spoiling
from tests.testbed.models import edited


@pytest.mark.parametrize("example", ["pendulum", "robot"])
def test_a_spoilt_file_of_a_model_is_read_or_refused_with_a_sentence(
    example: str, tmp_path: Path
) -> None:
    folder = edited(example, tmp_path)
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    ends: Counter[str] = Counter()

    @spoiling.FUZZ
    @given(
        name=st.sampled_from([*files]),
        xml=spoiling.XML_SWAPS,
        edits=spoiling.SOME_EDITS,
    )
    def spoil(name: str, xml: list[spoiling.XmlSwap], edits: list[spoiling.Edit]) -> None:
        content = files[name] if name == "model.toml" else spoiling.swapped_xml(files[name], xml)
        try:
            (folder / name).write_bytes(spoiling.edited(content, edits))
            Simulation(read_folder(folder)).check_factors()
            ends[f"{name} read"] += 1
        except ModelError as error:
            said = str(error)
            assert said and "\n" not in said and len(said) < 2000, said
            ends[f"{name} refused"] += 1
        finally:
            (folder / name).write_bytes(files[name])

    spoil()
    assert {"read", "refused"} == {end.split()[-1] for end in ends}, ends
    print(dict(ends))
