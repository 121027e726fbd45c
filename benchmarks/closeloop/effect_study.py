"""From measured trials to a new ranking, once through: docs/measurements/effect_study.md.

`python -m benchmarks.closeloop.effect_study [--rows 40] [--fidelity bushing]`

Records a relaxed arm in a robot whose elbow rubs, closes the loop with the nominal model, and runs
the two studies of `rehyb study with-effect` on a coordinator and workers of this machine.
"""

import argparse
import json
import tempfile
from pathlib import Path

from analysis.closeloop.loop import analyse
from analysis.closeloop.report.effect_study import study_with_effects
from benchmarks.closeloop.patient import CASES, session_of
from benchmarks.machine import describe_machine
from rehyb.client import Client
from rehyb.fleet import LocalFleet

CASE, OUTPUT = "robot friction 2.8 Nm", "stiffness_error"
MODELS = {"bushing": "elbow_bushing_effects", "campaign": "elbow_effects"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=40)
    parser.add_argument("--fidelity", default="bushing", choices=MODELS)
    options = parser.parse_args()
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        session_of(folder / "session", CASES[CASE], options.fidelity)
        report = json.loads(json.dumps(analyse(folder / "session").report))
        for effect in report["effects"]:
            for name, entry in effect["parameters"].items():
                low, high = entry["ci90"]
                print(
                    f"found {effect['name']}: {name} {entry['value']:.2f} "
                    f"[{low:.2f}, {high:.2f}] {entry['unit']}"
                )
        with (
            LocalFleet(folder / "fleet", workers=2) as fleet,
            Client(fleet.url, fleet.token) as client,
        ):
            for title, from_none in (("over its interval", False), ("from none", True)):
                study = study_with_effects(
                    report,
                    model=MODELS[options.fidelity],
                    method="morris",
                    rows=options.rows,
                    from_none=from_none,
                )
                number = client.submit(study)["id"]
                client.wait(number)
                factors = client.indices(number)["outputs"][OUTPUT]["factors"]
                print(f"the effect {title}: mu* of {OUTPUT}, Nm/rad")
                for name, entry in sorted(
                    factors.items(), key=lambda item: -item[1]["mu_star"]["value"]
                ):
                    mu = entry["mu_star"]
                    print(f"  {name:32s} {mu['value']:5.2f} [{mu['low']:.2f}, {mu['high']:.2f}]")


if __name__ == "__main__":
    main()
