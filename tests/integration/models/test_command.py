"""A program that answers is heard; one that does anything else is a named failure and is gone."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from models.command import Command
from models.evaluation import ModelFailure
from models.folder import read_folder
from tests.testbed.models import EXAMPLES, edited

#: What the program does instead of answering, at x1 = 0.
TROUBLES = {
    "hangs": ("time.sleep(60)", "timed_out", "no answer in time"),
    "floods": ("print('x' * 6_000_000)", "bad_answer", "more than 5 MB"),
    "talks": ("print('hello')", "bad_answer", "'hello', which is not one line of JSON"),
    "hoards": ("bytearray(6 * 2**30)", "crashed", "it said last: MemoryError"),
    "exits": ("sys.exit('the disk is full')", "crashed", "said last: the disk is full"),
    "dies": ("os.kill(os.getpid(), 9)", "crashed", "ended by SIGKILL"),
    "fails": ("""print('{"outcome": "diverged", "reason": "r"}')""", "diverged", "r"),
    "misnames": ("""print('{"outcome": "Bad Name"}')""", "bad_answer", "must be 1 to 40"),
    "says both": (
        """print('{"outcome": "diverged", "outputs": {"y": 1}}')""",
        "bad_answer",
        "outputs beside the outcome 'diverged'",
    ),
    "repeats itself": (
        "print('{}\\n{}')",
        "bad_answer",
        "besides its answer: it must print one line for each",
    ),
    "forgets": ("""print('{"outputs": {}}')""", "bad_answer", "output y is missing"),
    "is well": ("""print('{"outcome": "ok"}')""", "bad_answer", "the outcome 'ok' without outputs"),
    "invents": ("""print('{"outputs": {"y": 1, "z": 2}}')""", "bad_answer", "'z' is not in"),
    "stammers": (
        """print('{"outputs": {"y": 1, "y": 2}}')""",
        "bad_answer",
        "the program answered with 'y' twice",
    ),
    "counts": (
        """print('{"outputs": {"y": ' + '9' * 5000 + '}}')""",
        "not_finite",
        "y came out as",
    ),
    "worries": ("""print('{"outputs": {"y": NaN}}')""", "not_finite", "y came out as nan"),
    "writes": ("""print('{"outputs": {"y": "1"}}')""", "bad_answer", "must be a number"),
}
BEFORE = "    y = sin("


@pytest.fixture(params=[True, False], ids=["kept", "started each time"])
def keep(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def command(scratch: Path, *, does: str = "pass", keep: bool = True, limit: float = 3.0) -> Command:
    """Return the Ishigami program, which does something else at x1 = 0."""
    trouble = (
        f"    if x['x1'] == 0:\n        {does}\n        sys.stdout.flush()\n        continue\n"
    )
    changes = {
        BEFORE: trouble + BEFORE,
        "import sys\n": "import os\nimport sys\nimport time\n",
        "time_limit = 10": f"time_limit = {limit}",
        "keep = true": f"keep = {str(keep).lower()}",
    }
    return Command(read_folder(edited("ishigami_python", scratch, changes)))


@pytest.fixture
def closing() -> Iterator[list[Command]]:
    commands: list[Command] = []
    yield commands
    for one in commands:
        one.close()


@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_has_a_name_and_the_next_point_is_evaluated(
    trouble: str, keep: bool, tmp_path: Path, closing: list[Command]
) -> None:
    does, outcome, words = TROUBLES[trouble]
    program = command(tmp_path, does=does, keep=keep, limit=20.0)
    closing.append(program)
    patient = program._description
    if trouble == "hangs":
        program._description = replace(patient, time_limit=0.5)
    with pytest.raises(ModelFailure) as caught:
        program({"x1": 0.0})
    assert (caught.value.outcome, words in caught.value.reason) == (outcome, True)
    # To start Python may take longer than what hangs is given.
    program._description = patient
    assert program({"x1": 0.5})["y"] == pytest.approx(0.479425538604203)


@pytest.mark.parametrize("instead", ["sys.exit()", "os.close(1); time.sleep(60)"])
def test_a_program_that_ends_early_says_what_it_must_do(
    instead: str, keep: bool, tmp_path: Path
) -> None:
    with pytest.raises(ModelFailure) as caught:
        command(tmp_path, does=instead, keep=keep)({"x1": 0.0})
    how = "exited with status 0" if "exit" in instead else "closed its output"
    must = "with keep = true it must stay, and print" if keep else "it must print"
    assert f"the program {how} before it answered: {must}" in caught.value.reason
    assert "one line of JSON" in caught.value.reason


def test_a_kept_program_is_one_process_and_its_answers_are_the_awk_ones(
    tmp_path: Path, closing: list[Command]
) -> None:
    python = Command(read_folder(EXAMPLES / "ishigami_python"))
    awk = Command(read_folder(EXAMPLES / "ishigami_awk"))
    closing += [python, awk]
    for x in ({"x1": 0.3, "x2": -1.5, "x3": 2.5e-7}, {"x1": -3.0, "x2": 2.0, "x3": -1e-5}):
        assert python(x)["y"] == pytest.approx(awk(x)["y"], rel=1e-12)


def test_what_a_program_forked_ends_with_it(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    does = f"os.system('sleep 300 & echo $! > {pid_file}'); print('?')"
    program = command(tmp_path, does=does)
    with pytest.raises(ModelFailure):
        program({"x1": 0.0})
    forked = int(pid_file.read_text())
    deadline = time.monotonic() + 10.0
    while _runs(forked) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not _runs(forked)


def test_a_late_line_is_no_answer_though_its_program_has_ended(tmp_path: Path) -> None:
    late = 'print(\'{"outputs": {"y": 1}}\', flush=True); time.sleep(0.2)'
    program = command(tmp_path, does=f"{late}; {late}; sys.exit(0)")
    assert program({"x1": 0.0})["y"] == 1.0
    time.sleep(1.0)
    with pytest.raises(ModelFailure, match="before it was asked: it must print one line"):
        program({"x1": 0.5})


def test_an_answer_to_a_line_that_was_not_read_is_none(tmp_path: Path) -> None:
    # More than a pipe takes, so that the end of the line would come with the next one.
    more = "".join(
        f'[[factors]]\nname = "{"f" * 35}{number:05}"\nunit = "1"\nlow = 0.0\nhigh = 1.0\n'
        "nominal = 1.2345678901234567e-300\n"
        for number in range(990)
    )
    folder = edited("ishigami_python", tmp_path, {"[[outputs]]": f"{more}[[outputs]]"})
    program = Command(read_folder(folder))
    (folder / "ishigami.py").write_text(
        # Asked by then, on a busy machine, too.
        """import time\ntime.sleep(2)\nprint('{"outputs": {"y": 1}}', flush=True)\ntime.sleep(60)"""
    )
    with pytest.raises(ModelFailure, match="answered before it had read its line"):
        program({})


#: Runs a program in a process that adopts orphans, as a worker's child does; prints what came out.
IN_A_CHILD = """
import resource, sys
from dataclasses import replace
from pathlib import Path
from models.command import Command
from models.evaluation import ModelFailure
from models.folder import read_folder
from models.processes import adopt_orphans, children
import os
resource.setrlimit(resource.RLIMIT_DATA, (300 * 2**20, resource.RLIM_INFINITY))
adopt_orphans()
program = Command(read_folder(Path(sys.argv[1])))
try:
    for _ in range(int(sys.argv[2])):
        program({"x1": 0.0})
    print("ok")
except ModelFailure as failure:
    print(failure)
program.close()
print("left:", len(children(os.getpid())))
"""


def ran_in_a_child(folder: Path, times: int = 1) -> str:
    words = [sys.executable, "-c", IN_A_CHILD, str(folder), str(times)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def test_a_line_too_many_is_no_answer_to_the_next_line_of_a_program_that_repeats_what_it_was_asked(
    tmp_path: Path, closing: list[Command]
) -> None:
    """It came while the next line was under way: two points of a newcomer were -999."""
    answer = """    print(json.dumps({"outputs": {"y": y}}), flush=True)"""
    stray = """    if x["x1"] == 1.0:
        print('{"outputs": {"y": -999}}', flush=True)
        time.sleep(0.3)
    print(json.dumps({"parameters": x, "outputs": {"y": y}}), flush=True)"""
    changes = {answer: stray, "import sys\n": "import sys\nimport time\n"}
    program = Command(read_folder(edited("ishigami_python", tmp_path, changes)))
    closing.append(program)
    rest = {"x2": 0.5, "x3": 0.5}
    first = program({"x1": 0.3, **rest})
    with pytest.raises(ModelFailure, match=r"bad_answer: .* answered with no parameters, not with"):
        program({"x1": 1.0, **rest})
    assert program({"x1": 0.3, **rest}) == first


def test_its_memory_is_counted_with_that_of_all_it_started(tmp_path: Path) -> None:
    does = (
        "[os.fork() or (bytearray(150 * 2**20), time.sleep(30), os._exit(0)) for _ in range(4)];"
        "time.sleep(20)"
    )
    command(tmp_path, does=does, limit=20.0)
    said = ran_in_a_child(tmp_path / "ishigami_python")
    assert "crashed: the program and what it started take" in said
    assert "left: 0" in said


def test_the_memory_of_all_that_quick_answers_leave_behind_is_counted(tmp_path: Path) -> None:
    does = "os.fork() or (bytearray(150 * 2**20), time.sleep(30), os._exit(0)); time.sleep(0.1)"
    command(tmp_path, does=f'{does}; print(\'{{"outputs": {{"y": 1}}}}\')', limit=20.0)
    said = ran_in_a_child(tmp_path / "ishigami_python", times=20)
    assert "crashed: the program and what it started take" in said
    assert "left: 0" in said


def test_what_detaches_itself_from_a_program_ends_with_it_all_the_same(tmp_path: Path) -> None:
    does = "os.system('setsid sleep 300 >/dev/null 2>&1 </dev/null &'); print('?')"
    command(tmp_path, does=does, limit=20.0)
    said = ran_in_a_child(tmp_path / "ishigami_python")
    assert "bad_answer" in said and "left: 0" in said


def test_a_program_that_is_not_there_says_so(tmp_path: Path) -> None:
    folder = edited("ishigami_python", tmp_path, {'"python3"': '"no-such-program"'})
    with pytest.raises(ModelFailure, match="no-such-program cannot be started: No such file"):
        Command(read_folder(folder))({})


def _runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    os.kill(pid, 0)
    return state != "Z"
