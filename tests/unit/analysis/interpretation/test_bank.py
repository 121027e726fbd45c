"""A bank is one file; what is none, or cannot grow, is one sentence."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from analysis.interpretation.bank.bank import load_bank
from analysis.interpretation.build import empty_bank, grow
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter
from tests.testbed.bank import bank, samples
from tests.testbed.spoiling import encrypted


def test_a_damaged_bank_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "bank.npz"
    bank().save(path)
    with np.load(path) as file:
        own = {name: file[name] for name in file.files}

    def sentence(arrays: dict[str, np.ndarray]) -> str:
        np.savez(path, **arrays)  # type: ignore[arg-type]
        with pytest.raises(InterpretationError) as raised:
            Interpreter.read(load_bank(path))
        assert "\n" not in str(raised.value)
        return str(raised.value)

    for name, array in own.items():
        said = sentence({n: a for n, a in own.items() if n != name})
        what = "its arrays are not those of" if name.startswith("fitted.") else name
        assert what.removeprefix("meta") in said
        if array.ndim and array.size:
            cut = sentence({**own, name: array[: len(array) // 2]})
            assert "is a damaged bank" in cut
        if array.dtype.kind == "f" and array.size:
            assert f"{name} has values that are not" in sentence({**own, name: np.nan * array})
    short = {**own, "bushing.factors": own["bushing.factors"][:-1]}
    assert "of bushing do not fit" in sentence(short)


def test_a_bank_that_lacks_what_a_later_version_learns_says_how_to_learn_it(tmp_path: Path) -> None:
    made = bank()
    for missing in made.fitted:
        kept = {name: array for name, array in made.fitted.items() if name != missing}
        replace(made, fitted=kept).save(tmp_path / "bank.npz")
        again = "`rehyb bank build --extend --rows 240 --contact-rows 0` learns again"
        with pytest.raises(InterpretationError, match=f"has no {missing}: {again}"):
            Interpreter.read(load_bank(tmp_path / "bank.npz"))


def test_half_a_bank_is_damaged_and_a_folder_is_none(tmp_path: Path) -> None:
    path = tmp_path / "bank.npz"
    bank().save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InterpretationError, match="is damaged"):
        load_bank(path)
    with pytest.raises(InterpretationError, match="is a folder, and a bank is one file"):
        load_bank(tmp_path)


def test_a_bank_is_one_file(tmp_path: Path) -> None:
    made = bank()
    made.save(tmp_path / "bank.npz")
    read = load_bank(tmp_path / "bank.npz")
    assert read.id == made.id
    (recording,) = samples(2, 1).of(*RECORDED)
    view = Interpreter.read(read).look(recording)
    assert np.array_equal(view.mean, Interpreter.read(made).look(recording).mean)


PLAIN = BytesIO()
np.save(PLAIN, np.zeros(3))


def test_what_is_no_bank_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "bank.npz"
    with pytest.raises(InterpretationError, match="there is no bank"):
        load_bank(path)
    for content in (b"", b"a bank", PLAIN.getvalue()):
        path.write_bytes(content)
        with pytest.raises(InterpretationError, match="is no bank"):
            load_bank(path)
    np.savez(path, a=np.zeros(2))
    with pytest.raises(InterpretationError, match="is no bank"):
        load_bank(path)
    path.write_bytes(encrypted(path.read_bytes()))
    with pytest.raises(InterpretationError, match="is no bank"):
        load_bank(path)
    np.savez(path, meta=np.array(json.dumps({"schema": 99})))
    with pytest.raises(InterpretationError, match="another version"):
        load_bank(path)


def test_too_few_rows_are_refused_before_anything_is_simulated() -> None:
    with pytest.raises(InterpretationError, match="3 rows without contact are too few"):
        grow(empty_bank(bank().population, 1), rows=3, contact_rows=100000, processes=1)


def test_too_few_rows_with_contact_say_the_least_number_and_why() -> None:
    with pytest.raises(InterpretationError, match=r"10 rows with .* how far .* take 60 or more"):
        grow(empty_bank(bank().population, 1), rows=4096, contact_rows=10, processes=1)


def test_banks_that_answer_otherwise_have_other_names() -> None:
    """One bank, learnt from with one and with two threads, gave two answers under one name."""
    made = bank()
    for name, array in made.fitted.items():
        other = replace(made, fitted={**made.fitted, name: array + 1e-7})
        assert other.id != made.id, name
    assert replace(made, fitted=dict(reversed(made.fitted.items()))).id == made.id


def test_a_bank_of_other_versions_is_not_extended() -> None:
    with pytest.raises(InterpretationError, match="other versions"):
        grow(bank(), rows=400, contact_rows=0, processes=1)
