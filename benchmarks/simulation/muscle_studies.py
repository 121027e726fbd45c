"""The paper's two-phase study for each set of muscles, side by side.

`python -m benchmarks.simulation.muscle_studies DIRECTORY [MODEL [N [R]]]`: R rows of phase 1
(default 150) and N of phase 2 (default 512) of MODEL (default `elbow`, with contact;
`elbow_bushing` is without). Each study is kept in a folder of DIRECTORY: run again, the command
goes on where it was.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from analysis.designs import DEFAULT_SAMPLING
from benchmarks.machine import describe_machine
from sim.parameters.conditions import MUSCLES

OUTPUTS = (
    "stiffness_error",
    "stiffness_error_authors",
    "stiffness_estimate",
    "stiffness_true",
    "stiffness_passive",
    "stiffness_sum",
    "stiffness_true_r2",
    "stiffness_true_r2_authors",
    "local_stiffness_start",
    "local_stiffness_middle",
    "local_stiffness_end",
)


def study(directory: Path, muscles: str, model: str, n: int, r: int) -> dict[str, Any]:
    """Run, resume or read one study, and return its report."""
    options = {
        "--preset": "paper",
        "--model": model,
        "--screening-rows": str(r),
        "--variance-rows": str(n),
        "--sampling": DEFAULT_SAMPLING,
        "--fix": f"muscles={muscles}",
        "--local-workers": "1",
        "--directory": str(directory / muscles),
    }
    words = [word for option in options.items() for word in option]
    ran = subprocess.run(
        [sys.executable, "-m", "rehyb", "campaign", "run", *words, "--json"],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    report: dict[str, Any] = json.loads(ran.stdout)
    return report


def index(found: dict[str, Any]) -> str:
    """Return an index in words; an output that never varies has none."""
    return "none" if found["value"] is None else f"{found['value']:.2f}"


def print_study(muscles: str, report: dict[str, Any]) -> None:
    print(f"\n{muscles}: phase 1 fixes {report['fixed']}; failures {report['failures'] or 'none'}")
    effects = report["phase1"]["outputs"]["stiffness_error"]["factors"]
    order = sorted(effects, key=lambda name: -effects[name]["mu_star"]["value"])
    print(
        "  mu* of stiffness_error: "
        + ", ".join(f"{name} {effects[name]['mu_star']['value']:.2f}" for name in order)
    )
    outputs = report["phase2"]["outputs"]
    names = list(outputs[OUTPUTS[0]]["factors"])
    print(f"  {'S / ST':26s} {'mean':>6s} {'sd':>5s}  " + "  ".join(f"{n:>20s}" for n in names))
    for output in OUTPUTS:
        found = outputs[output]
        cells = [
            f"{index(found['factors'][n]['first_order']):>9s} / "
            f"{index(found['factors'][n]['total_order'])}"
            for n in names
        ]
        print(
            f"  {output:26s} {found['mean']:6.2f} {found['sd']:5.2f}  "
            + "  ".join(f"{cell:>20s}" for cell in cells)
        )


def main(directory: Path, model: str = "elbow", n: str = "512", r: str = "150") -> None:
    print(describe_machine())
    for muscles in MUSCLES:
        print_study(muscles, study(directory, muscles, model, int(n), int(r)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python -m benchmarks.simulation.muscle_studies DIRECTORY [MODEL [N [R]]]")
    main(Path(sys.argv[1]), *sys.argv[2:])
