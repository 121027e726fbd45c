"""What passive degrees of freedom do to the error of K_h: `nesm_passive` beside `nesm`.

`python -m benchmarks.interpretation.passive BANK [--wearers 512] [--varied 32] [--keep FOLDER]`

BANK is of the NESM, and its first rows are learnt from. The wearers are the first of those whom the
page `interpretation` reports on (seed 7141), with contact; only those count whom both devices hold.
The other device gets a bank of its own, of as many rows of the same population and seed. Then its
assumptions are varied, one at a time, and five wearers show where the axes lie. `--keep` keeps what
was simulated and uses it again.
"""

import argparse
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from analysis.interpretation.bank.bank import CONTACT_ROWS, Bank, Samples, load_bank
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.inference.rows import JOINTS, targets_of
from benchmarks.interpretation.judging import judge
from benchmarks.interpretation.ways import BY_SETS, TAPE, WHATEVER, print_ways
from benchmarks.interpretation.wearers import FRESH, Wearers, simulated
from benchmarks.machine import describe_machine
from sim.assessment.assess import assess
from sim.assessment.donning import HOLD
from sim.robot.device import FOLDER, NESM
from sim.system.system import System

PASSIVE = "nesm_passive"
#: Lengths of the upper arm of five wearers, m: the nominal one in the middle.
LENGTHS = (0.29, 0.3137, 0.3337, 0.3537, 0.375)
#: A passive joint's line in the device's file.
JOINT = r' *<joint name="passive_{}"[^>]*/>\n'
HORIZONTAL = (
    '            <joint name="passive_horizontal" class="hinge" axis="0 1 0" range="-20 20"/>\n'
)
OWN_CUFF = 'size="0.035 0.025" pos="0.0108 0.15 -0.015"'


def _replaced(old: str, new: str) -> Callable[[str], str]:
    """Return a change of a device's file: a regular expression that must be found, replaced."""

    def change(text: str) -> str:
        changed, count = re.subn(old, new, text)
        assert count, old
        return changed

    return change


def _without(*names: str) -> Callable[[str], str]:
    """Return a change of the device's file: it has not the passive joints of these names."""

    def change(text: str) -> str:
        for name in names:
            text = _replaced(JOINT.format(name), "")(text)
        return _posed(text, -len(names))

    return change


def _posed(text: str, more: int) -> str:
    """Return the file with so many passive joints more in its keyframes."""
    old = " ".join(["0"] * 4)
    return re.sub(
        rf'(qpos="[^"]*?) {old} (\S+")', lambda m: " ".join([m[1], *["0"] * (4 + more), m[2]]), text
    )


def _turning(text: str) -> str:
    """Return the file with NEUROExos' turn on the horizontal plane, in line with J3."""
    at = text.index("            <!-- The authors stop")
    return _posed(text[:at] + HORIZONTAL + text[at:], 1)


#: What is assumed of the device, otherwise.
VARIED: Mapping[str, Callable[[str], str]] = {
    "along by 3 cm, as across": _replaced('"-0.05 0.05"', '"-0.015 0.015"'),
    "across by 10 cm, as along": _replaced(
        r'(passive_across" class="slide" axis="1 0 0" range=)"[^"]*"', r'\1"-0.05 0.05"'
    ),
    "springs of 2000 N/m": _replaced(
        'type="slide" damping', 'type="slide" stiffness="2000" damping'
    ),
    "friction of guides 10 N": _replaced('frictionloss="2"', 'frictionloss="10"'),
    "the cuff of nesm, 5 cm": _replaced('size="0.035 0.06" pos="0.0108 0.14 -0.015"', OWN_CUFF),
    "turn about the upper arm": _turning,
    "along alone": _without("cuff", "across", "frontal"),
    "no passive joint": _without("cuff", "along", "across", "frontal"),
}


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bank", type=Path)
    parser.add_argument("--wearers", type=int, default=512)
    parser.add_argument("--varied", type=int, default=32)
    parser.add_argument("--rows", type=int, nargs=2, default=(1024, 256), help="of both banks")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    bank = load_bank(asked.bank)
    population = bank.population
    print(describe_machine())
    wearers = {
        device: simulated(population, FRESH, range(asked.wearers), keep=asked.keep, device=device)
        for device in (NESM.name, PASSIVE)
    }
    both = np.intersect1d(wearers[NESM.name].samples.rows, wearers[PASSIVE].samples.rows)
    print(f"\n{asked.wearers} wearers with contact, {len(both)} of them held by both devices")
    for device, one in wearers.items():
        print(f"  {device:14}{len(one):5} held, {dict(one.samples.failed)} failed")
    banks = (_cut(bank, asked.rows), _bank(bank, asked.rows, asked.keep))
    for device, one, of in zip(wearers, wearers.values(), banks, strict=True):
        _print_device(device, of, one.some(np.isin(one.samples.rows, both)).samples)
    _print_varied(bank, wearers, asked)
    _print_axes()


def _cut(bank: Bank, rows: tuple[int, int]) -> Bank:
    """Return the rows of a bank with numbers below those of `rows`, and learn from them."""
    bushing, contact = rows
    return _learnt(
        bank,
        bank.bushing.some(bank.bushing.rows < bushing),
        bank.contact.some(bank.contact.rows < CONTACT_ROWS + contact),
    )


def _learnt(like: Bank, bushing: Samples, contact: Samples) -> Bank:
    bank = replace(like, fitted={}, bushing=bushing, contact=contact)
    return replace(bank, fitted=Interpreter.fit(bank).arrays)


def _bank(like: Bank, rows: tuple[int, int], keep: Path | None) -> Bank:
    """Return a bank of the other device with the population and seed of `like`, and learn."""

    def part(numbers: range, level: str) -> Samples:
        found = simulated(
            like.population, like.seed, numbers, keep=keep, device=PASSIVE, level=level
        ).samples
        return found.some(np.isfinite(found.values).all(axis=1))

    bushing, contact = rows
    return _learnt(
        like,
        part(range(bushing), "bushing"),
        part(range(CONTACT_ROWS, CONTACT_ROWS + contact), "contact"),
    )


def _print_device(device: str, bank: Bank, fresh: Samples) -> None:
    """Print errors of regressions and answers of one device, and widths of its intervals."""
    interpreter = Interpreter.read(bank)
    zero = bank.population.zero_errors(FRESH, fresh.rows, JOINTS)
    print(f"\n== {device}: bank of {len(bank.bushing)} bushings, {len(bank.contact)} with contact")
    truth, paper = targets_of(fresh)[:, 0], -fresh.of("stiffness_estimate_paper")[:, 0]
    own = fresh.of("true_stiffness_paper")[:, 0]
    for name, error in (("K_h", paper - truth), ("its own truth", paper - own)):
        print(f"  paper's regression, of {name:15} {_line(error)}")
    answers, widths = {}, []
    for name, look in ((WHATEVER, Interpreter.look), (BY_SETS, Interpreter.look_by_sets)):
        alone = judge(interpreter, fresh, zero, look=look)
        told = judge(interpreter, fresh, zero, TAPE, seed=FRESH, look=look)
        answers[name] = (alone, told)
        for what, judged in (("", alone), (", identified", told)):
            held = 100 * judged.coverage(np.ones(len(fresh), bool))
            half = np.median(judged.half_widths[:, 0])
            widths.append(f"  {name + what:48}{held:6.1f}{half:10.2f}")
    print_ways(bank, fresh, answers)
    _print_slopes(bank, fresh, -fresh.of("stiffness_estimate")[:, 0] - truth)
    print("90 % intervals                                    hold, %  half width (median)")
    print("\n".join(widths))


def _print_slopes(bank: Bank, fresh: Samples, error: np.ndarray) -> None:
    """Print what the error goes by: factors of a population depend on each other."""
    spread = fresh.factors.std(axis=0)
    inputs = (fresh.factors - fresh.factors.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    slopes = np.linalg.lstsq(inputs, error - error.mean())[0]
    most = np.argsort(-np.abs(slopes))[:4]
    said = ", ".join(f"{bank.population.names[i]} {slopes[i]:.2f}" for i in most)
    print(f"affine alone by least squares, Nm/rad per standard deviation: {said}")


def _line(error: np.ndarray) -> str:
    """Return mean, standard deviation and what 90 % of errors are below, Nm/rad."""
    return f"{error.mean():8.2f}{error.std():7.2f}{np.quantile(np.abs(error), 0.9):10.2f}"


def _print_varied(bank: Bank, wearers: Mapping[str, Wearers], asked: argparse.Namespace) -> None:
    """Print what each assumption of the device does to the error of the affine regression."""
    count = asked.varied
    print(
        f"\naffine, the first {count} wearers      held    mean     sd   90 % of errors are below"
    )
    for device, one in wearers.items():
        _print_affine(device, one.samples.some(one.samples.rows < count))
    text = (FOLDER / f"{PASSIVE}.xml").read_text()
    with tempfile.TemporaryDirectory() as folder:
        for name, change in VARIED.items():
            path = Path(folder) / f"{re.sub(r'[^a-z0-9]+', '_', name)}.xml"
            path.write_text(change(text))
            worn = simulated(
                bank.population, FRESH, range(count), keep=asked.keep, device=str(path)
            )
            _print_affine(name, worn.samples)


def _print_affine(name: str, samples: Samples) -> None:
    error = -samples.of("stiffness_estimate")[:, 0] - targets_of(samples)[:, 0]
    print(f"  {name:34}{len(samples):4}{_line(error)}")


def _print_axes() -> None:
    """Print how far the axes of both elbows are apart, and what presses on the limbs."""
    print(
        "\nnominal wearer but for the     axes apart, mm      force on, N, mean       affine's\n"
        "upper arm's length, m       start   end   mean    upper arm  forearm          error"
    )
    for device in (NESM.name, PASSIVE):
        print(f"  {device}")
        for length in LENGTHS:
            apart: list[float] = []

            def watch(system: System, data: mujoco.MjData, apart: list[float] = apart) -> None:
                if data.time >= HOLD and not data.eq_active[system.locks].any():
                    apart.append(axes_apart(data))

            found = assess({"upper_arm_length": length}, device=device, watch=watch)
            if found.record is None:
                print(f"    {length:.4f}  {found.outcome}")
                continue
            upper, fore = found.record.loads.contact_force.mean(axis=0)
            start, end, mean = (1e3 * value for value in (apart[0], apart[-1], np.mean(apart)))
            error = found.outputs.get("stiffness_error", np.nan)
            print(
                f"    {length:.4f}{start:18.1f}{end:7.1f}{mean:7.1f}{upper:11.0f}{fore:10.0f}"
                f"{error:15.2f}"
            )


def axes_apart(data: mujoco.MjData) -> float:
    """Return how far the human elbow is from the robot's axis, m."""
    joint = data.joint("J4")
    between = data.body("ulna").xpos - joint.xanchor
    return float(np.linalg.norm(between - joint.xaxis * (between @ joint.xaxis)))


if __name__ == "__main__":
    main()
