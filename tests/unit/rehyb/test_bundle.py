"""A bundle holds up when it is honest, and every way of tampering with it is found and named."""

import hashlib
import json
import struct
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from rehyb.bundle.archive import MANIFEST, MEMBERS, read_bundle, write_bundle
from rehyb.bundle.reproduce import Finding, check
from rehyb.bundle.study import request_of
from rehyb.errors import Conflict, Invalid
from tests.testbed.coordinators.finished_study import ROWS, WIDTH, FinishedStudy
from tests.testbed.spoiling import encrypted

Members = dict[str, bytes]


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("honest") / "s1.zip"
    write_bundle(FinishedStudy().client(), "s1", path)
    return path


def members_of(path: Path) -> Members:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def pack(path: Path, members: Iterable[tuple[str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


def with_hashes(members: Members) -> Members:
    """Return the members with a manifest that states what they are: a forger who knows how."""
    manifest = json.loads(members[MANIFEST])
    for name in MEMBERS:
        manifest["files"][name]["sha256"] = hashlib.sha256(members[name]).hexdigest()
    return {**members, MANIFEST: json.dumps(manifest).encode()}


def findings(path: Path, tmp_path: Path, **options: Any) -> dict[str, Finding]:
    folder = tmp_path / "unpacked"
    folder.mkdir(exist_ok=True)
    return {one.check: one for one in check(read_bundle(path, folder), **options)}


def test_an_honest_bundle_holds_in_every_point(honest: Path, tmp_path: Path) -> None:
    found = findings(honest, tmp_path)
    assert list(found) == ["hashes", "design", "failures", "indices", "runs"]
    assert all(one.holds for one in found.values())
    assert found["design"].sentence == (
        "the parameters of 30 results follow from seed 5, bit for bit"
    )
    assert "the ledger tells of every failed run (1)" in found["failures"].sentence
    assert found["indices"].sentence.endswith("again, bit for bit")
    assert found["runs"].sentence == "10 of 30 runs, computed again, come out bit for bit"


def test_the_manifest_says_who_computed_what_with_which_versions(honest: Path) -> None:
    manifest = json.loads(members_of(honest)[MANIFEST])
    assert (manifest["study"], manifest["seed"], manifest["results"]) == ("s1", 5, ROWS * WIDTH)
    assert manifest["failures"] == {"lost": 1}
    assert manifest["identity"] == FinishedStudy().identity
    assert manifest["workers"] == [{"id": "pc", "host_class": "c0ffee", "versions": {"numpy": "2"}}]
    assert {"rehyb", "numpy", "scipy", "python"} == set(manifest["bundled_with"])


def test_the_same_study_gives_the_same_bytes(honest: Path, tmp_path: Path) -> None:
    digest = write_bundle(FinishedStudy().client(), "s1", tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == honest.read_bytes()
    assert digest == hashlib.sha256(honest.read_bytes()).hexdigest()


def test_indices_that_lag_behind_the_results_are_no_bundle(tmp_path: Path) -> None:
    coordinator = FinishedStudy()
    coordinator.indices = {**coordinator.indices, "evaluations": {"ok": 20}}
    with pytest.raises(Conflict, match="has 30 results and indices of 20: wait until"):
        write_bundle(coordinator.client(), "s1", tmp_path / "s1.zip")
    assert list(tmp_path.iterdir()) == []


def replaced(name: str, old: str, new: str) -> Callable[[Members], Members]:
    """Return a forger who replaces a text, once, in one member."""

    def forge(members: Members) -> Members:
        text = members[name].decode()
        assert old in text
        return {**members, name: text.replace(old, new, 1).encode()}

    return forge


def a_value(members: Members) -> Members:
    """Change the last digits of one output."""
    lines = members["results.csv"].decode().splitlines()
    cells = lines[1].split(",")
    cells[6] = str(float(cells[6]) * 1.001)
    lines[1] = ",".join(cells)
    return {**members, "results.csv": ("\n".join(lines) + "\n").encode()}


def a_number_that_is_none(members: Members) -> Members:
    lines = members["results.csv"].decode().splitlines()
    cells = lines[2].split(",")
    cells[6] = "nan"
    lines[2] = ",".join(cells)
    return {**members, "results.csv": ("\n".join(lines) + "\n").encode()}


def a_word(members: Members) -> Members:
    forged = a_number_that_is_none(members)
    return {**forged, "results.csv": forged["results.csv"].replace(b",nan,", b",hello,")}


def an_index(members: Members) -> Members:
    indices = json.loads(members["indices.json"])
    indices["outputs"]["y"]["factors"]["x1"]["total_order"]["value"] *= 1.0 + 1e-12
    return {**members, "indices.json": json.dumps(indices).encode()}


@pytest.mark.parametrize(
    ("forge", "fails", "words"),
    [
        (a_value, {"indices", "runs"}, "do not come out of the results"),
        (an_index, {"indices"}, "1 numbers in indices.json do not come out of the results, /outp"),
        (replaced("study.json", '"seed": 5', '"seed": 6'), {"design", "indices", "runs"}, "row 0"),
        (
            replaced("results.csv", ",lost,", ",ok,"),
            {"failures", "indices", "runs"},
            "tells of 1 failures",
        ),
        (replaced("failures.json", '"row": 2', '"row": 1'), {"failures"}, "0 of the 1 in results"),
        (replaced("results.csv", "\n0,0,", "\n0,1,"), {"design", "indices", "runs"}, "twice"),
        (replaced("results.csv", "\n0,0,", "\n99,0,"), {"design", "indices"}, "(99, 0) lies out"),
        (replaced("results.csv", "\n0,0,", "\nx,0,"), {"contents"}, "results.csv cannot be read"),
        (
            a_word,
            {"contents"},
            "cannot be read: line 3: y must be a number, not 'hello'",
        ),
        (replaced("results.csv", "position", "place"), {"contents"}, "no table of study s1: no po"),
        (
            replaced("study.json", '"ishigami"', '"leg"'),
            {"contents"},
            "of the model 'leg'",
        ),
        (replaced("study.json", '"rows": 6', '"rows": 1e99'), {"contents"}, "no study that can be"),
        (replaced("study.json", '"name"', '"nom"'), {"contents"}, "it has no 'name'"),
        (replaced("study.json", '"seed": 5', '"seed": -5'), {"contents"}, "seed -5 is none"),
        (
            a_number_that_is_none,
            {"indices", "runs"},
            "of 29 of 30 runs, computed again, 1 differ by up to inf standard deviations",
        ),
    ],
)
def test_a_forger_who_mends_the_hashes_is_found_all_the_same(
    honest: Path, tmp_path: Path, forge: Callable[[Members], Members], fails: set[str], words: str
) -> None:
    forged = with_hashes(forge(members_of(honest)))
    found = findings(pack(tmp_path / "forged.zip", forged.items()), tmp_path, sample=30)
    assert found["hashes"].holds
    failing = {name for name, one in found.items() if not one.holds}
    assert failing == fails
    assert words in " ".join(found[name].sentence for name in found if name in fails)


def test_a_changed_member_does_not_match_its_hash(honest: Path, tmp_path: Path) -> None:
    changed = replaced("indices.json", '"seed": 5', '"seed": 7')(members_of(honest))
    found = findings(pack(tmp_path / "changed.zip", changed.items()), tmp_path)
    assert found["hashes"].sentence == "indices.json: not what manifest.json states"
    assert not found["hashes"].holds and not found["indices"].holds


def test_another_code_is_named_where_runs_differ(honest: Path, tmp_path: Path) -> None:
    members = members_of(honest)
    manifest = json.loads(members[MANIFEST])
    manifest["identity"]["code"] = "an older one"
    members = with_hashes(a_value({**members, MANIFEST: json.dumps(manifest).encode()}))
    found = findings(pack(tmp_path / "old.zip", members.items()), tmp_path, sample=30)
    assert "it was computed with code an older one" in found["runs"].sentence
    loose = findings(tmp_path / "old.zip", tmp_path, sample=30, tolerance=0.1)
    assert loose["runs"].holds and "standard deviations (y of row 0" in loose["runs"].sentence


def test_the_sample_is_chosen_by_its_seed(
    honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sim.evaluation import evaluate

    seen: list[Any] = []

    def noted(model: str, x: Any, curves: Any) -> Any:
        seen.append(x)
        return evaluate(model, x, curves)

    monkeypatch.setattr("sim.evaluation.evaluate", noted)
    for seed in (1, 1, 2):
        findings(honest, tmp_path, sample=4, seed=seed)
    assert seen[:4] == seen[4:8] != seen[8:]


def test_the_request_submits_the_same_study_again(honest: Path, tmp_path: Path) -> None:
    request = request_of(read_bundle(honest, tmp_path).study)
    assert (request["model"], request["rows"], request["seed"]) == ("ishigami", ROWS, 5)
    assert "id" not in request and "state" not in request


def lying_about_its_size(path: Path) -> Path:
    """Write a member of ten million bytes that is said to have a hundred."""
    pack(path, [(n, b"0" * 10**7 if n == "study.json" else b"{}") for n in (MANIFEST, *MEMBERS)])
    data = bytearray(path.read_bytes())
    name = b"study.json"
    # Sizes stand 4 bytes after the CRC, before the name: in the header, and in the directory.
    for before, at in ((30, data.index(name)), (46, data.rindex(name))):
        size = at - before + 22 + (2 if before == 46 else 0)
        assert struct.unpack_from("<I", data, size) == (10**7,)
        struct.pack_into("<I", data, size, 100)
    path.write_bytes(data)
    return path


def test_a_bundle_with_a_password_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = pack(tmp_path / "b.zip", [(name, b"{}") for name in (MANIFEST, *MEMBERS)])
    path.write_bytes(encrypted(path.read_bytes()))
    with pytest.raises(Invalid, match=r"b\.zip is no bundle: manifest\.json is encrypted"):
        read_bundle(path, tmp_path)


def test_a_bundle_that_is_packed_in_an_unknown_way_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = pack(tmp_path / "b.zip", [(name, b"{}") for name in (MANIFEST, *MEMBERS)])
    changed = bytearray(path.read_bytes())
    for mark, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        changed[changed.index(mark) + offset] = 99
    path.write_bytes(changed)
    with pytest.raises(Invalid, match=r"b\.zip is no bundle, or is damaged: That compression"):
        read_bundle(path, tmp_path)


def test_what_unpacks_to_more_than_it_says_is_refused_without_unpacking(tmp_path: Path) -> None:
    path = lying_about_its_size(tmp_path / "bomb.zip")
    with pytest.raises(Invalid, match=r"bomb\.zip is no bundle, or is damaged: Bad CRC"):
        read_bundle(path, tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: [*m, ("../../etc/passwd", b"x")], "'../../etc/passwd', which no bundle has"),
        (lambda m: [*m, ("/etc/passwd", b"x")], "'/etc/passwd', which no bundle has"),
        (lambda m: m[:-1], "it has no failures.json"),
        (lambda m: [*m, m[1]], "it has study.json twice"),
        (lambda m: [(n, b"0" * 10**7 if n == "study.json" else c) for n, c in m], "more than one"),
        (lambda m: [(n, b"[]" if n == MANIFEST else c) for n, c in m], "manifest.json is not a JS"),
        (lambda m: [(n, b"{" if n == "indices.json" else c) for n, c in m], "indices.json is not "),
        (lambda m: [(n, b"[" * 10**5 if n == "study.json" else c) for n, c in m], "more than one"),
        (
            lambda m: [(n, b"[7]" if n == "failures.json" else c) for n, c in m],
            "failures.json is n",
        ),
        (lambda m: [(n, b'{"format": 9}' if n == MANIFEST else c) for n, c in m], "has format 9"),
    ],
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_what_is_no_bundle_is_refused_in_a_sentence_and_leaves_nothing_behind(
    honest: Path, tmp_path: Path, change: Callable[[Any], Any], words: str
) -> None:
    bad = pack(tmp_path / "bad.zip", change(list(members_of(honest).items())))
    folder = tmp_path / "unpacked"
    folder.mkdir()
    with pytest.raises(Invalid, match=r"bad\.zip") as refused:
        read_bundle(bad, folder)
    assert words in str(refused.value)
    assert {path.name for path in folder.iterdir()} <= {"results.csv"}


def test_a_file_cut_short_or_garbled_is_refused(honest: Path, tmp_path: Path) -> None:
    whole = honest.read_bytes()
    bad = tmp_path / "bad.zip"
    for end in (0, 10, len(whole) // 2, len(whole) - 1):
        bad.write_bytes(whole[:end])
        with pytest.raises(Invalid, match="is no bundle, or is damaged"):
            read_bundle(bad, tmp_path)
    for at in range(0, len(whole), 97):
        bad.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            read = read_bundle(bad, tmp_path)
        except Invalid:
            continue
        assert read.manifest["study"] == "s1"
