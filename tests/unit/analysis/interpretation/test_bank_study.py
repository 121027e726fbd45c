"""A bank's recordings as a study: the same wearers, and what is kept of them."""

import copy

import numpy as np
import pytest

from analysis.designs import instance_parameters
from analysis.designs.dependence import Dependence, copula
from analysis.designs.distributions import Distribution
from analysis.interpretation.bank.bank import CONTACT_ROWS, KEPT
from analysis.interpretation.bank.population import default_population, population_of
from analysis.interpretation.bank.study import samples_of, study_of
from analysis.interpretation.errors import InterpretationError
from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.table import Table
from sim.parameters.conditions import CONTACT_ONLY

OURS = default_population()
LEVELS = ("bushing", "contact")


def test_a_study_of_wearers_with_contact_samples_what_the_population_draws() -> None:
    """By the study's own design and copula, to what two ways of rounding leave."""
    asked = study_of(OURS, 3, "contact", 8)
    distributions = {
        factor["name"]: Distribution.from_json(factor["distribution"])
        for factor in asked["factors"]
    }
    assert tuple(distributions) == OURS.names
    pairs = tuple((a, b, value) for a, b, value in asked["correlations"])
    correlation = copula(
        Dependence(pairs=pairs), tuple(distributions), tuple(distributions.values())
    )
    drawn = OURS.draw(asked["seed"], np.arange(8))
    for row in range(8):
        (point,) = instance_parameters(
            "sample", "sobol", asked["seed"], row, distributions, correlation
        )
        np.testing.assert_allclose(list(point.values()), drawn[row], rtol=1e-9, atol=1e-12)


def test_levels_and_seeds_share_no_wearer_and_a_population_names_its_study() -> None:
    seeds = {study_of(OURS, seed, level, 8)["seed"] for seed in (1, 2) for level in LEVELS}
    assert len(seeds) == 4 and all(0 <= seed < 2**63 for seed in seeds)
    other = population_of({**copy.deepcopy(dict(OURS.content)), "name": "ward 3"}, "here")
    names = [study_of(people, 1, "bushing", 8)["name"] for people in (OURS, other)]
    assert names[0] != names[1] and "ward 3" in names[1]


def test_the_name_of_a_study_is_one_that_a_coordinator_takes() -> None:
    long = population_of({**copy.deepcopy(dict(OURS.content)), "name": 20 * "ward 3, "}, "here")
    assert len(study_of(long, 2**63, "contact", 8)["name"]) <= 128


def test_what_only_contact_has_is_no_factor_without_it() -> None:
    asked = study_of(OURS, 1, "bushing", 8)
    sampled = {factor["name"] for factor in asked["factors"]}
    assert sampled == set(OURS.names) - set(CONTACT_ONLY)
    assert not {*CONTACT_ONLY} & {*asked["fixed"]}


def test_a_factor_that_is_left_out_and_depends_on_one_that_is_not_is_refused() -> None:
    content = copy.deepcopy(dict(OURS.content))
    tension = next(name for name in CONTACT_ONLY if name in OURS.names)
    content["correlations"] = [[tension, "upper_arm_length", 0.5]]
    people = population_of(content, "here")
    study_of(people, 1, "contact", 8)
    with pytest.raises(InterpretationError, match="depend on each other"):
        study_of(people, 1, "bushing", 8)


def test_a_bank_keeps_the_first_rows_that_can_be_believed_and_counts_the_others() -> None:
    asked = study_of(OURS, 1, "contact", 4)
    plan = StudyPlan(
        id="s",
        method="sample",
        seed=asked["seed"],
        sampling="sobol",
        rows=5,
        factors=tuple(factor["name"] for factor in asked["factors"]),
        outputs=tuple(reversed(KEPT)),
    )
    values = np.arange(5.0)[:, None] + np.zeros(len(KEPT))
    values[1] = np.nan
    table = Table(
        plan=plan,
        # As results came in.
        rows=np.array([4, 2, 1, 0, 3]),
        positions=np.zeros(5, dtype=np.int64),
        outcomes=("ok", "ok", "strap_lost", "ok", "ok"),
        points=np.array([4.0, 2.0, 1.0, 0.0, 3.0])[:, None] + np.zeros(len(plan.factors)),
        values=values[[4, 2, 1, 0, 3]],
    )
    kept = samples_of(OURS, 1, "contact", table, 4)
    assert kept.rows.tolist() == [CONTACT_ROWS, CONTACT_ROWS + 2, CONTACT_ROWS + 3]
    assert kept.factors[:, 0].tolist() == kept.values[:, 0].tolist() == [0.0, 2.0, 3.0]
    assert kept.failed == {"strap_lost": 1} and kept.drawn == 4
