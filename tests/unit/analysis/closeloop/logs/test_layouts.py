"""Logs as the programs of laboratories write them: what is read and believed of each."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.clock import clock_of
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.joints import joint_names
from analysis.closeloop.logs.log import Log
from analysis.closeloop.logs.reading import read_log

TIME = 0.005 * np.arange(800)
ANGLE = 0.8 * np.sin(2 * TIME) + 0.2 * np.sin(5.1 * TIME)
VELOCITY = 1.6 * np.cos(2 * TIME) + 1.02 * np.cos(5.1 * TIME)
TORQUE = 4 * np.sin(ANGLE) + 0.3 * np.sign(VELOCITY)
DEG = 180 / np.pi
CLOCK, JOINT, LOAD = ("time", "s"), ("position", "deg"), ("effort", "Nm")


def written(
    path: Path, head: str, row: str, *, comma: bool = False, encoding: str = "utf-8"
) -> Log:
    """Write a log of lines like `row`, with fields t, ms, q, deg, v, u and n, and read it."""
    lines = [
        row.format(t=t, ms=1e3 * t, q=q, deg=DEG * q, v=v, u=u, n=n)
        for n, (t, q, v, u) in enumerate(zip(TIME, ANGLE, VELOCITY, TORQUE, strict=True))
    ]
    text = "\n".join(lines)
    text = text.replace(".", ",") if comma else text
    path.write_text(f"{head}\n{text}\n", encoding=encoding, newline="\r\n")
    return read_log(path)


def told(log: Log) -> dict[str, tuple[str, str]]:
    return {b.channel.name: (b.quantity, b.unit) for b in believe(log)}


def timed(log: Log) -> list[Belief]:
    """Return what is believed of a log, whose clock is right."""
    beliefs = believe(log)
    for belief in beliefs:
        time = belief.channel.time
        assert time is not None and len(time) == len(TIME)
        assert clock_of(time).rate == pytest.approx(200.0, rel=1e-4)
    return beliefs


THREE = "{t:.3f},{deg:.4f},{u:.4f}"


@pytest.mark.parametrize(
    ("head", "row", "comma", "encoding"),
    [
        # Names, units below, and lines above that are as wide or are not.
        ("Zeit,Winkel,Moment\ns,Grad,Nm", THREE, False, "utf-8-sig"),
        ("Messung 3,,\nRate,200,\nZeit,Winkel,Moment\ns,deg,Nm", THREE, False, "utf-8"),
        (
            "P01\nRate;200\n\nZeit [s];Winkel [°];Moment [Nm]",
            "{t:.3f};{deg:.4f};{u:.4f}",
            True,
            "utf-16",
        ),
        # Names among comments, separated or not as the numbers are.
        (
            "% a lab\n% Zeit Winkel Moment\n% s deg Nm",
            "  {t:.4e}  {deg:.4e}  {u:.4e}",
            False,
            "utf-8",
        ),
        ("# Zeit_s Winkel_deg Moment_Nm", THREE, False, "utf-8"),
        ("// Zeit (s), Winkel (deg), Moment (N·m)", THREE, False, "utf-8"),
        # Between spaces, also within names, with decimal commas.
        (
            "Zeit (s)   Der Winkel (deg)   Moment (Nm)",
            "{t:.3f}   {deg:.3f}  {u:.3f}",
            True,
            "latin-1",
        ),
        # A separator at the end of each line, or of those of numbers.
        ("Zeit [s];Winkel [°];Moment [Nm]", "{t:.3f};{deg:.3f};{u:.3f};", False, "latin-1"),
        ("Zeit [s];Winkel [°];Moment [Nm];", "{t:.3f};{deg:.3f};{u:.3f};", False, "latin-1"),
        # Stamps, and durations of a timetable.
        ("Stamp,Winkel [°],Moment [Nm]", "2026-01-05T10:00:{t:06.3f}Z,{deg},{u}", False, "utf-8"),
        ("Stamp\tWinkel [°]\tMoment [Nm]", "05.01.2026 9:00:{t:06.3f}\t{deg}\t{u}", False, "utf-8"),
        ("Stamp;Winkel [°];Moment [Nm]", "00:00:{t:06.3f};{deg:.3f};{u:.3f}", True, "utf-8"),
        ("Stamp,Winkel [°],Moment [Nm]", "{t:g} sec,{deg:.3f},{u:.3f}", False, "utf-8"),
    ],
)
def test_a_time_an_angle_and_a_torque(
    tmp_path: Path, head: str, row: str, comma: bool, encoding: str
) -> None:
    log = written(tmp_path / "log.txt", head, row, comma=comma, encoding=encoding)
    time, angle, torque = timed(log)
    assert [(b.quantity, b.unit) for b in (time, angle, torque)] == [CLOCK, JOINT, LOAD]
    assert "Winkel" in angle.channel.name and (angle.joint, torque.joint) == (0, 0)
    assert angle.channel.values == pytest.approx(DEG * ANGLE, abs=1e-2)


def test_a_robot_of_universal_robots(tmp_path: Path) -> None:
    """Its recorder parts columns by spaces; a tool's force is no joint's."""
    head = "timestamp actual_q_0 actual_qd_0 actual_current_0 target_q_0 actual_TCP_force_0"
    log = written(tmp_path / "log.csv", head, "{t:.4f} {q} {v} {u} {q} {u}")
    found = timed(log)
    assert [b.quantity for b in found] == [
        *("time", "position", "velocity", "current", "position", "unknown")
    ]
    assert [b.wanted for b in found] == [False] * 4 + [True, False]


def test_topics_of_a_plotter_and_of_rostopic(tmp_path: Path) -> None:
    """An empty last column, and a header that begins with %."""
    names = [f"/joints/elbow/{quantity}" for quantity in ("position", "velocity", "effort")]
    log = written(
        tmp_path / "plotjuggler.csv",
        f"__time,{','.join(names)},/rosout/level",
        "{t:.3f},{q},{v},{u},",
    )
    assert [belief.channel.name for belief in timed(log)][1:4] == names
    head = "%time,field.name0,field.position0,field.effort0"
    log = written(tmp_path / "rostopic.csv", head, "{ms:.0f}000000,elbow,{q},{u}")
    assert told(log) == {
        "time": ("time", "ns"),
        "field.position0": ("position", "rad?"),
        "field.effort0": ("effort", "?"),
    }


def test_a_joint_state_that_a_plotter_wrote_has_the_units_and_joints_of_its_topic(
    tmp_path: Path,
) -> None:
    """A pendulum's angle of 326 rad, about which it turned 52 times, was taken for degrees."""
    head = "__time,/joint_states/joint0/position,/joint_states/joint0/effort"
    found = timed(written(tmp_path / "log.csv", head, "{t:.3f},{deg},{u}"))
    assert [b.unit for b in found] == ["s", "rad", "Nm"]
    assert joint_names(found) == ["joint0"]


def test_a_dynamometer(tmp_path: Path) -> None:
    head = "Dynamometer 4\nName: P01\n\nmSec   TORQUE   POSITION   POS (ANAT)   VELOCITY"
    log = written(tmp_path / "log.txt", head, "{ms:.0f}   {u:.3f}   {deg:.3f}   {q:.3f}   {v:.3f}")
    found = {b.channel.name: b for b in timed(log)}
    assert (found["mSec"].quantity, found["mSec"].unit) == ("time", "ms")
    assert found["TORQUE"].quantity == "effort" and found["POSITION"].joint == 0


def test_two_lines_of_names_and_one_of_units(tmp_path: Path) -> None:
    """As of motion capture: the same three names for each thing, which the line above names."""
    head = (
        "Model Outputs\n200\n,,P1:LElbowAngles,,P1:LElbowMoment,\n"
        "Frame,Sub Frame,X,Y,X,Y\n,,deg,deg,N.mm/kg,N.mm/kg"
    )
    log = written(tmp_path / "log.csv", head, "{n},0,{deg},{v},{u},{v}")
    assert [channel.name for channel in log.channels] == [
        *("Frame", "Sub Frame", "P1:LElbowAngles X [deg]", "P1:LElbowAngles Y [deg]"),
        *("P1:LElbowMoment X [N.mm/kg]", "P1:LElbowMoment Y [N.mm/kg]"),
    ]
    assert told(log)["P1:LElbowAngles X [deg]"] == JOINT


def test_a_table_of_opensim_and_columns_of_one_name(tmp_path: Path) -> None:
    head = "Coordinates\nversion=1\nendheader\ntime\telbow_angle\telbow_angle"
    log = written(tmp_path / "log.sto", head, "{t}\t{q}\t{u}")
    assert [c.name for c in log.channels] == ["time", "elbow_angle", "elbow_angle (2)"]


def test_words_for_a_missing_sample_are_no_header(tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv", "t,angle,torque\n0.0,-,n/a\n0.001,null,-", "1{t},{q},{u}")
    assert [int(np.isnan(c.values).sum()) for c in log.channels] == [0, 2, 2]


@pytest.mark.parametrize("program", ["dSPACE", "Simulink"])
def test_signals_that_a_structure_names(tmp_path: Path, program: str) -> None:
    from scipy.io import savemat

    own = {"dSPACE": ("Name", "Data", "Unit"), "Simulink": ("label", "values", "blockName")}
    rows = [
        ("Root/elbow_angle/Out1", DEG * ANGLE, "deg"),
        ("Root/elbow_torque/Out1", TORQUE, "Nm"),
    ]
    signals = np.array(rows, dtype=[(name, "O") for name in own[program]])
    clock = {"Name": "time", "Data": TIME, "Unit": "s"} if program == "dSPACE" else TIME
    savemat(tmp_path / "log.mat", {"rec": {"X": clock, "Y": signals}})
    beliefs = timed(read_log(tmp_path / "log.mat"))
    assert [b.quantity for b in beliefs] == ["time", "position", "effort"]
    assert joint_names(beliefs, ["wrist", "elbow"]) == ["elbow"]
