"""Table 1's wearers as bodies are: lengths and masses of one arm that go together.

Of ANSUR II (Gordon et al. 2014, 2012 Anthropometric survey of U.S. Army personnel,
NATICK/TR-15/007; public data of 4082 men and 1986 women, each sex half of a population) are the
rank correlations and the relative spreads, around the paper's nominal wearer, cut at Table 1's
ends. The lengths are acromion to radiale and radiale to stylion; masses, which it does not have, go
with length times squared circumference (flexed biceps, flexed forearm), as those of cylinders of
one density do. Nobody measured the stiffness of soft tissue beside them: elasticities are Table
1's.
"""

from typing import Any

from sim.parameters.wearer import TABLE_1

#: Standard deviation over mean.
SPREADS = {
    "upper_arm_length": 0.065,
    "forearm_length": 0.080,
    "upper_arm_mass": 0.29,
    "forearm_mass": 0.27,
}
#: Spearman's, of every pair.
CORRELATIONS = (
    ("upper_arm_length", "forearm_length", 0.81),
    ("upper_arm_length", "upper_arm_mass", 0.66),
    ("upper_arm_length", "forearm_mass", 0.71),
    ("forearm_length", "upper_arm_mass", 0.66),
    ("forearm_length", "forearm_mass", 0.80),
    ("upper_arm_mass", "forearm_mass", 0.92),
)


def distribution(name: str, *, spread: bool = True) -> dict[str, Any]:
    """Return the distribution of a factor of Table 1, as a study takes it.

    `spread`: whether it is as bodies are spread, or uniform over Table 1's range.
    """
    factor = next(factor for factor in TABLE_1 if factor.name == name)
    ends = {"low": factor.low, "high": factor.high}
    if not spread or name not in SPREADS:
        return {"kind": "uniform", **ends}
    of_mean = {"mean": factor.nominal, "sd": SPREADS[name] * factor.nominal}
    return {"kind": "truncated_normal", **of_mean, **ends}


#: What `rehyb study submit --preset anthropometric` begins with.
STUDY: dict[str, Any] = {
    "method": "shapley",
    "rows": 512,
    "factors": [
        {"name": factor.name, "distribution": distribution(factor.name)} for factor in TABLE_1
    ],
    "correlations": [list(pair) for pair in CORRELATIONS],
    "correlation_kind": "rank",
}
