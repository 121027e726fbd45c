"""Units in the names of channels, in whatever language the rest of the name is."""

import pytest

from analysis.closeloop.unit_names import split_unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("Gelenkwinkel [°]", "deg"),
        ("Angle (deg) left", "deg"),
        ("angle_degrees", "deg"),
        ("Winkel in Grad", "deg"),
        ("Vitesse / deg/s", "deg/s"),
        ("POS DEG/SEC", "deg/s"),
        ("vel_rad_s", "rad/s"),
        ("w (rad s^-1)", "rad/s"),
        ("v [deg·s⁻¹]", "deg/s"),
        ("acc [rad/s²]", "rad/s2"),
        ("Drehzahl [1/min]", "rpm"),
        ("Couple (N·m)", "Nm"),
        ("M [N m]", "Nm"),
        ("Torque FT-LBS", "ftlb"),
        ("torque [lbf·ft]", "ftlb"),
        ("torque_in_lb", "inlb"),
        ("torque [lbf-in]", "inlb"),
        ("torque (ozf.in)", "inoz"),
        ("Drehmoment [kgf·cm]", "kgfcm"),
        ("elbow_torque_kgfcm", "kgfcm"),
        ("elbow_torque_kgf_cm", "kgfcm"),
        ("Moment [kp m]", "kgfm"),
        ("T [kNm]", "kNm"),
        ("pos [mrad]", "mrad"),
        ("pos_mdeg", "mdeg"),
        ("angle coude (degrés)", "deg"),
        ("ángulo [grados]", "deg"),
        ("elbow_pos_turns", "turns"),
        ("pos [rev]", "turns"),
        ("speed [rev/s]", "turns/s"),
        ("speed [rev/min]", "rpm"),
        ("Zeit / ms", "ms"),
        ("t [µs]", "us"),
        ("Motorstrom, mA", "mA"),
        ("u_V", "V"),
    ],
)
def test_a_unit_is_read_however_it_is_written(name: str, unit: str) -> None:
    assert split_unit(name)[1] == unit


@pytest.mark.parametrize(
    "name", ["", "u_v", "q[0]", "temperature [°C]", "gradient", "joints/elbow/position"]
)
def test_what_is_no_unit_is_none(name: str) -> None:
    assert split_unit(name) == (name, None, False)


def test_a_name_of_any_length_is_read_at_once() -> None:
    assert split_unit("_ [" * 100_000)[1] is None


def test_a_unit_before_the_number_of_an_array_s_column_is_read() -> None:
    """Torques of a KUKA's `act_torque_abs_nm[0]` had no unit."""
    assert split_unit("rec.act_torque_nm[0]") == ("rec.act_torque_[0]", "Nm", True)
    assert split_unit("act_torque_nm/[11]") == ("act_torque_/[11]", "Nm", True)
    assert split_unit("signals[2]") == ("signals[2]", None, False)
