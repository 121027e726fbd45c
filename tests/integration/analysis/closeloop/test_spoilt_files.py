"""Whatever a session's files hold, it is read or refused with a sentence: `make soak` goes on."""

import io
import json
import zipfile
from collections import Counter
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.session.archive import unpacked
from tests.testbed import spoiling
from tests.testbed.sessions.small import Folder


def _refused(error: SessionError) -> None:
    said = str(error)
    assert said and "\n" not in said and len(said) < 2000, said


def test_a_spoilt_file_of_a_session_is_read_or_refused_with_a_sentence(tmp_path: Path) -> None:
    session = Folder(tmp_path)
    session.table = session.table[:400]
    session.write()
    files = {name: (tmp_path / name).read_bytes() for name in ("session.json", "device.xml")}
    files["a.csv"] = (tmp_path / "a.csv").read_bytes()
    asked = json.loads(files["session.json"])
    ends: Counter[str] = Counter()

    @spoiling.FUZZ
    @given(
        name=st.sampled_from([*files]),
        swaps=spoiling.SWAPS,
        xml=spoiling.XML_SWAPS,
        edits=spoiling.SOME_EDITS,
    )
    def spoil(
        name: str,
        swaps: list[tuple[int, bytes]],
        xml: list[spoiling.XmlSwap],
        edits: list[spoiling.Edit],
    ) -> None:
        content = files[name]
        if name == "session.json":
            content = spoiling.swapped(asked, swaps)
        if name == "device.xml":
            content = spoiling.swapped_xml(content, xml)
        try:
            (tmp_path / name).write_bytes(spoiling.edited(content, edits))
            load_session(tmp_path)
            ends[f"{name} read"] += 1
        except SessionError as error:
            _refused(error)
            ends[f"{name} refused"] += 1
        finally:
            (tmp_path / name).write_bytes(files[name])

    spoil()
    assert {"read", "refused"} == {end.split()[-1] for end in ends}, ends
    print(dict(ends))


def test_a_spoilt_zip_file_is_unpacked_or_refused_with_a_sentence(tmp_path: Path) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("s/session.json", json.dumps({"schema": 1}) * 20)
        archive.writestr("s/a.csv", "time,elbow.position\n" * 50)

    ends: Counter[str] = Counter()

    @spoiling.FUZZ
    @given(edits=spoiling.EDITS)
    def spoil(edits: list[spoiling.Edit]) -> None:
        file = tmp_path / "session.zip"
        file.write_bytes(spoiling.edited(packed.getvalue(), edits))
        try:
            with unpacked(file) as folder:
                assert (folder / "session.json").exists()
            ends["session.zip unpacked"] += 1
        except SessionError as error:
            _refused(error)
            ends["session.zip refused"] += 1

    spoil()
    print(dict(ends))
