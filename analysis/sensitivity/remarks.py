"""What a reader of a snapshot should know besides the numbers, in sentences.

A snapshot that an earlier version left in a database lacks some of it; then there is no remark.
"""

from collections.abc import Mapping
from typing import Any

from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.screening import SHARE_OF_LARGEST
from analysis.sensitivity.judgement.stopping import advise, no_spread
from analysis.sensitivity.records import said_of
from models.factors import SEED

#: Intervals of an index that rests on fewer rows than this may hold the truth less often than they
#: say: half of them, of a rare event in 64 rows (`tests/unit/analysis/sensitivity/test_tails.py`).
FEWEST_ROWS = 2.0
#: A line that explains less of the muscles' torque than this is no stiffness of theirs. Ours.
LEAST_R2 = 0.9
#: Indices that are shares of the variance, which are never above 1.
_SHARES = ("first_order", "total_order")
#: A stiffness and, per form of the regression, the r squared of its truth.
_TRUTH_R2 = "stiffness_true_r2"


def warning(snapshot: Mapping[str, Any]) -> str:
    """Return what failures do to the indices; empty unless they depend on the factors."""
    failure = snapshot.get("failure", {})
    return str(failure["sentence"]) if failure.get("depends_on_factors") else ""


def remarks(snapshot: Mapping[str, Any], output: str, target: float | None = None) -> list[str]:
    """Return what the study says of its failures, its ranking and its precision.

    Args:
        snapshot: of a study.
        output: one of its outputs.
        target: half width wanted of every interval (`judgement.stopping.advise`).

    Raises:
        ValueError: as `analysis.sensitivity.judgement.stopping.advise`.
    """
    found = [str(snapshot.get("failure", {}).get("sentence", ""))]
    found.append(_sample(snapshot))
    found.append(no_spread(snapshot, output))
    found.append(_own_noise(snapshot, output))
    found.append(_worst_case(snapshot, output))
    found.append(_ranking(said_of(snapshot, output).get("ranking", {}), output))
    found.append(str(said_of(snapshot, output).get("trust", {}).get("sentence", "")))
    found.append(_few_runs_at_points(snapshot, output))
    found.append(_above_one(snapshot, output))
    found.append(_screened(said_of(snapshot, output).get("screening"), output))
    found.append(_no_single_stiffness(snapshot, output))
    found.append(_few_rows(snapshot, output))
    found.append(_one_sequence(snapshot))
    if "sampling" in snapshot:
        advice = advise(snapshot, output, target)
        found.append("" if advice is None else advice.sentence)
    return [sentence for sentence in found if sentence]


def _sample(snapshot: Mapping[str, Any]) -> str:
    """Return where to look for what a plain sample tells of its factors."""
    if snapshot.get("method") != "sample":
        return ""
    return (
        "A sample says how outputs spread and has no indices while it arrives: "
        f"rehyb study analyse {snapshot['study']} says what it tells of each factor."
    )


def _own_noise(snapshot: Mapping[str, Any], output: str) -> str:
    """Return which share of the variance is the model's own noise.

    The seed is sampled like a factor, and its total-order index is the mean over the factors of
    the variance that is left when they are fixed, by the variance of the output (Marrel, Iooss,
    Da Veiga and Ribatet 2012, Global sensitivity analysis of stochastic computer models with joint
    metamodels, Statistics and Computing 22, 833-847). It is estimated as any other total-order
    index (Jansen 1999): half the mean squared difference of two runs at the same point with other
    seeds, by the variance.
    """
    factors = said_of(snapshot, output).get("factors", {})
    share = factors.get(SEED.name, {}).get("total_order")
    if share is None or share["value"] is None:
        return ""
    return (
        f"The model's own noise is {share['value']:.1%} of the variance of {output} "
        f"({share['low']:.1%} to {share['high']:.1%}): the total-order index of its seed."
    )


def _screened(screening: Mapping[str, Any] | None, output: str) -> str:
    """Return which factors surely do less than what matters, and of which it is open."""
    if screening is None or screening["threshold"] is None:
        return ""
    if screening["by"] == "mu_star":
        what = f"μ* below {screening['threshold']:.2g}, {SHARE_OF_LARGEST:.0%} of the largest"
    else:
        what = f"ST below {screening['threshold']:.2g}"
    none = "none yet" if screening["undecided"] else "none"
    sentence = (
        f"Non-influential on {output} ({what}; a dummy factor has {screening['dummy']:g}): "
        f"{', '.join(screening['non_influential']) or none}."
    )
    if screening["undecided"]:
        sentence += f" Undecided: {', '.join(screening['undecided'])}."
    return sentence


def no_single_stiffness(r_squared: float) -> str:
    """Return that one stiffness does not describe a movement, if a line explains that little."""
    if r_squared >= LEAST_R2:
        return ""
    return (
        "A single stiffness does not describe this movement: a line explains "
        f"{r_squared:.0%} of what the muscles' torque varies by. Look at the local stiffnesses."
    )


def _no_single_stiffness(snapshot: Mapping[str, Any], output: str) -> str:
    """Return that of a study of a stiffness, by its mean."""
    form = next((name for name in ("_paper", "_authors") if output.endswith(name)), "")
    mean = snapshot["outputs"].get(f"{_TRUTH_R2}{form}", {}).get("mean")
    if mean is None or not output.startswith("stiffness_"):
        return ""
    sentence = no_single_stiffness(float(mean))
    return sentence.replace("this movement", "these movements").replace(
        "explains ", "explains, on average, "
    )


def _worst_case(snapshot: Mapping[str, Any], output: str) -> str:
    """Return between which bounds the leading indices lie whatever failed runs would have said."""
    described = said_of(snapshot, output)
    by = described.get("ranking", {}).get("by")
    bounds = {
        name: factor["worst_case"][by]
        for name, factor in described.get("factors", {}).items()
        if factor.get("worst_case") and None not in factor["worst_case"][by].values()
    }
    if not bounds:
        return ""
    leading = sorted(bounds, key=lambda name: -float(bounds[name]["value"]))[:3]
    which = ", ".join(
        f"{name} {bounds[name]['low']:.2g} to {bounds[name]['high']:.2g}" for name in leading
    )
    return (
        f"Whatever the failed runs would have said within the range of {output} that was seen, "
        f"the true {SYMBOLS[by]} lies within: {which}."
    )


def _above_one(snapshot: Mapping[str, Any], output: str) -> str:
    """Return which intervals of shares of the variance lie above 1, where no share can."""
    above = [
        f"{SYMBOLS[index]} of {name}"
        for name, factor in said_of(snapshot, output).get("factors", {}).items()
        for index in _SHARES
        if (factor.get(index, {}).get("low") or 0.0) > 1.0
    ]
    if not above:
        return ""
    return (
        f"The whole interval of {', '.join(above)} on {output} lies above 1, where no share of the "
        "variance can: take it for 1 at most, and add rows before you trust it."
    )


def _few_rows(snapshot: Mapping[str, Any], output: str) -> str:
    """Return which total-order indices too few rows make up (Kish 1965, by `rests_on`)."""
    factors = said_of(snapshot, output).get("factors", {})
    known = {name: factor.get("rests_on") for name, factor in factors.items()}
    few = {name: rows for name, rows in known.items() if rows is not None and rows < FEWEST_ROWS}
    if not few:
        return ""
    which = ", ".join(few)
    return (
        f"Few rows make up the total-order index of {which} on {output}: as many as "
        f"{min(few.values()):.1f} of equal size would, of {snapshot['rows_used']:,}. Its interval "
        "may miss the truth more often than it says; more rows make it honest."
    )


def _few_runs_at_points(snapshot: Mapping[str, Any], output: str) -> str:
    """Return at how many points of a curve few runs make up the variance."""
    curve = snapshot.get("curves", {}).get(output, {})
    if not (places := curve.get("on_few_runs")):
        return ""
    return (
        f"At {len(places)} of {len(curve['axis'])} points of {output} few runs make up the "
        "variance: intervals and bands may miss the truth there more often than they say."
    )


def _one_sequence(snapshot: Mapping[str, Any]) -> str:
    """Return what intervals of one Sobol sequence are worth (docs/decisions/0006)."""
    if snapshot.get("method") == "sample":
        return ""
    if snapshot.get("sampling") not in ("sobol", "sobol_paired") or not snapshot["rows_used"]:
        return ""
    return (
        "Points of one Sobol sequence depend on each other: intervals are too wide on average, and "
        "may miss single factors all the same. Those of sampling owen_blocks are honest."
    )


def _ranking(ranking: Mapping[str, Any], output: str) -> str:
    if ranking.get("order") is None or len(ranking["order"]) < 2:
        return ""
    return (
        f"{ranking['same_order']:.0%} of the bootstrap replicates rank the factors of {output} in "
        f"the same order, {ranking['same_first']:.0%} with {ranking['order'][0]} first."
    )
