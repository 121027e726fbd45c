"""What joints share has to gain beside ordinary friction, and what left-out rows show of it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.agreed import nested_z
from analysis.closeloop.identification.arms.gains import with_gains
from analysis.closeloop.identification.arms.links import freed_links, links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import weighed
from analysis.closeloop.identification.arms.shared import with_share
from analysis.closeloop.identification.arms.whole_fit import WholeFit, loaded
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import compare, select_rows
from sim.effects.laws.inertia import OWN_INERTIA
from sim.effects.rigid import BALL, point_mass
from tests.testbed.sessions.coupled import measured, moving, traced, values
from tests.testbed.sessions.rich import ELBOW, rich_recording

#: Seconds, rows a second, and folds of a short trial.
SECONDS, ROWS, FOLDS = 14, 24, 6
BLOCK = np.repeat(np.arange(SECONDS), ROWS)


def left_out(rng: np.random.Generator, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Return held-out residuals without and with a constant that the other folds give."""
    noise = rng.standard_normal(SECONDS)[BLOCK] + rng.standard_normal(len(BLOCK))
    without = offset + noise
    fold = np.arange(len(BLOCK)) * FOLDS // len(BLOCK)
    others = np.array([without[fold != number].mean() for number in range(FOLDS)])
    return without, without - others[fold]


def shown(offset: float, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Return the statistic of nested fits and that of losses, over seeds."""
    nested, losses = [], []
    for seed in seeds:
        without, beside = left_out(np.random.default_rng(seed), offset)
        nested.append(nested_z(without, beside, BLOCK))
        gain, error = compare(*(np.bincount(BLOCK, left**2) for left in (without, beside)))
        losses.append(gain / error)
    return np.array(nested), np.array(losses)


def test_a_short_trial_shows_an_offset_that_its_losses_alone_would_miss() -> None:
    nested, losses = shown(1.6, range(60))
    assert np.median(nested) > 4.0 > 3.0 > np.median(losses)


def test_noise_shows_no_offset() -> None:
    nested, _ = shown(0.0, range(400))
    assert np.mean(nested) < 0.0
    assert np.mean(nested > 2.0) < 0.05
    assert np.mean(nested > 3.0) < 0.01


@pytest.mark.parametrize("mass", [0.0, 0.3])
def test_links_are_others_than_declared_only_if_friction_that_winds_up_does_not_say_so(
    mass: float,
) -> None:
    """It leaves torque at the ends of movements, where gravity has turned most."""
    still = rich_recording(20)
    effort = np.array(still.inverse)
    effort += mass * still.mass_torque(ELBOW, np.array([0.0, 0.0, -0.15]))
    for joint in still.joints:
        effort[:, joint] += 0.8 * unfitted(still, joint).wound(0.006)
    effort += 0.02 * np.random.default_rng(5).standard_normal(effort.shape)
    arm = replace(still, effort=still.filtered(effort), cache={})
    rows = select_rows(arm, (0,))
    model = with_ordinary(Model(arm), rows)
    shared = with_share(model, rows, links_of(arm), links_free=True)
    assert (shared is not model) == (mass > 0.0)


def test_links_that_are_as_declared_stay_so_beside_one_that_is_not() -> None:
    """An opponent's wrong links were refused since a joint lost by what ten free numbers cost."""
    still, wrong = rich_recording(20), 1
    links = links_of(still)
    effort = still.inverse - 0.3 * still.link_torque(links.bodies[wrong]) @ links.declared[wrong]
    effort += 0.05 * np.random.default_rng(6).standard_normal(effort.shape)
    arm = replace(still, effort=still.filtered(effort), cache={})
    rows = select_rows(arm, (0,)).reweighted({0: 0.05, ELBOW: 0.05})
    shared = with_share(with_ordinary(Model(arm), rows), rows, links, links_free=True)
    assert shared.given is not None
    assert freed_links(shared, links).names == (links.names[wrong],)
    mass = shared.given.links[links.names[wrong]][0] / links.declared[wrong, 0]
    # What the inertia of its motor does not take.
    assert mass == pytest.approx(0.7, abs=0.15)


def test_a_link_that_is_heavier_throughout_is_no_payload_on_it() -> None:
    """A stranger's links of 1.25 times their declared mass were loads beside their middle."""
    arm = moving()
    (two,) = links_of(arm).only((arm.body(1),)).declared
    torque = arm.rigid + 0.25 * arm.link_torque(arm.body(1)) @ two + 0.3 * np.sign(arm.velocity)
    found = traced(measured(arm, torque))
    assert {name for name, _ in found} == {"link_inertia", "coulomb_friction"}
    given = next(iter(found.values())).taken.model.given
    assert given is not None and list(given.links) == ["two"]
    assert given.links["two"][0] == pytest.approx(1.25 * two[0], rel=0.01)


def test_a_load_of_that_mass_at_its_far_end_stays_one() -> None:
    arm = moving()
    load = arm.mass_torque(1, np.array([0.2, 0.0, 0.0]))
    found = traced(measured(arm, arm.rigid + 0.1 * load + 0.3 * np.sign(arm.velocity)))
    assert ("payload", 1) in found and "link_inertia" not in {name for name, _ in found}


def test_a_load_has_an_inertia_of_its_own_and_no_joint_a_gain_for_it() -> None:
    """Beside a point mass a stranger's balls of 6 cm were gains, and their masses 3 to 11 % off."""
    arm, place = moving(), np.array([0.12, 0.03, -0.05])
    load = 0.5 * point_mass(place) + 0.004 * BALL
    loaded = measured(arm, arm.rigid + arm.link_torque(arm.body(1)) @ load)
    found = traced(loaded)
    assert list(found) == [("payload", 1)]
    told = values(found["payload", 1], loaded)
    assert told["mass"] == pytest.approx(0.5, rel=0.01)
    assert told["inertia"] == pytest.approx(0.004, rel=0.05)


def test_a_gain_is_not_the_inertia_of_a_load() -> None:
    """Where it was no ordinary inertia's any more, nothing asked for the gain."""
    arm = moving()
    load = 0.3 * point_mass(np.array([0.15, 0.03, 0.0])) + 0.002 * BALL
    effort = arm.rigid + arm.link_torque(arm.body(1)) @ load
    effort[:, 1] /= 0.9
    recording = measured(arm, effort)
    model, rows, links = Model(recording), select_rows(recording, (0,)), links_of(recording)
    rows = weighed(model, rows)
    heavier = loaded(model, rows, links, WholeFit(model, rows, links).with_load([], 1))
    assert OWN_INERTIA in heavier.terms[-1].kept
    gained = with_gains(heavier, rows)
    (hung, gain) = gained.terms
    assert gain.candidate is not None and gain.candidate.key == ("torque_gain", 1)
    mass, *_, inertia = evaluate(gained, rows).coefficients[: len(hung.kept)]
    assert mass == pytest.approx(0.3, rel=0.01)
    assert inertia == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize("place", [(0.15, 0.03, 0.0), (0.15, 0.0, 0.05)])
def test_a_load_is_found_whose_own_joint_has_a_gain_that_hides_it(
    place: tuple[float, float, float],
) -> None:
    """That joint reported as much as without it: gains, a spring and couplings had names."""
    arm = moving()
    effort = arm.rigid + 0.3 * arm.link_torque(arm.body(1)) @ point_mass(np.array(place))
    effort[:, 1] /= 1.15
    recording = measured(arm, effort)
    found = traced(recording)
    assert set(found) == {("payload", 1), ("torque_gain", 1)}
    assert values(found["payload", 1], recording)["mass"] == pytest.approx(0.3, rel=0.01)
    assert values(found["torque_gain", 1], recording)["gain"] == pytest.approx(1.15, rel=0.01)
