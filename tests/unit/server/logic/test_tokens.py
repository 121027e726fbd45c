"""Who may do what."""

import hashlib

import pytest

from server.logic.tokens import (
    FAILURE_SECONDS,
    FAILURES,
    SCOPES,
    Failures,
    digest,
    may,
    new_secret,
    scopes_needed,
)

READ, SUBMIT, WORK = ("read",), ("submit",), ("work",)


@pytest.mark.parametrize(
    ("method", "path", "needed"),
    [
        ("POST", "/v1/leases", WORK),
        ("POST", "/v1/leases/L/renew", WORK),
        ("POST", "/v1/results", WORK),
        ("GET", "/v1/leases/L", WORK),
        ("GET", "/openapi.json", SCOPES),
        ("POST", "/v1/sign-in-codes", ("read",)),
        ("GET", "/v1/studies", READ),
        ("HEAD", "/v1/studies/s", READ),
        ("OPTIONS", "/v1/studies/s", READ),
        ("GET", "/v1/sessions/a/archive", ("read", "work")),
        ("HEAD", "/v1/sessions/a/archive", ("read", "work")),
        ("GET", "/v1/sessions/a/archive/more", READ),
        ("GET", "/v1/sessions/a", READ),
        ("GET", "/v1/models", ("read", "work")),
        ("GET", "/v1/models/pendulum@3fa2/archive", ("read", "work")),
        ("GET", "/v1/modelsx", READ),
        ("POST", "/v1/models", ("submit", "work")),
        ("POST", "/v1/models/x", SUBMIT),
        ("POST", "/v1/studies", SUBMIT),
        ("DELETE", "/v1/sessions/a/archive", SUBMIT),
        ("POST", "/v1/close-loops", SUBMIT),
        ("POST", "/v1/close-loops/c/report", WORK),
        ("GET", "/v1/close-loops/c", READ),
        ("POST", "/v1/leasesx", SUBMIT),
        ("POST", "/v1/resultsx", SUBMIT),
    ],
)
def test_a_request_needs_the_scope_of_what_it_does(
    method: str, path: str, needed: tuple[str, ...]
) -> None:
    assert scopes_needed(method, path) == needed


@pytest.mark.parametrize(
    ("scopes", "needed", "allowed"),
    [
        (["read"], READ, True),
        (["read"], SUBMIT, False),
        (["work", "read"], ("submit", "work"), True),
        ([], READ, False),
        (["admin"], SUBMIT, True),
        (["admins"], SUBMIT, False),
    ],
)
def test_one_of_the_scopes_or_admin_is_enough(
    scopes: list[str], needed: tuple[str, ...], allowed: bool
) -> None:
    assert may(scopes, needed) is allowed


def test_secrets_are_long_and_told_from_each_other_and_only_a_digest_is_kept() -> None:
    one, other = new_secret(), new_secret()
    assert one.startswith("rehyb_") and len(one) == len("rehyb_") + 32 and one != other
    assert digest(one.encode()) == hashlib.sha256(one.encode()).hexdigest()


def test_twenty_wrong_tokens_within_a_minute_use_up_an_address() -> None:
    failures = Failures()
    for number in range(FAILURES):
        assert not failures.too_many("a", 10.0)
        failures.count("a", float(number) / 2)
    assert failures.too_many("a", 10.0)
    assert not failures.too_many("b", 10.0)


def test_wrong_tokens_of_more_than_a_minute_ago_are_forgotten() -> None:
    failures = Failures()
    for _ in range(FAILURES):
        failures.count("a", 10.0)
    assert failures.too_many("a", 10.0 + FAILURE_SECONDS - 0.1)
    assert not failures.too_many("a", 10.0 + FAILURE_SECONDS)
    for _ in range(FAILURES - 1):
        failures.count("a", 10.0 + FAILURE_SECONDS)
    assert not failures.too_many("a", 10.0 + FAILURE_SECONDS)


def test_an_address_that_goes_on_stays_shut_out_and_takes_no_more_memory() -> None:
    failures = Failures()
    for number in range(10 * FAILURES):
        failures.count("a", number / 100)
    assert failures.too_many("a", 50.0)
    assert [len(times) for times in failures._times.values()] == [FAILURES + 1]


def test_failures_from_everywhere_do_not_fill_the_memory() -> None:
    failures = Failures()
    for number in range(10_001):
        failures.count(str(number), 0.0)
    failures.count("late", FAILURE_SECONDS)
    assert list(failures._times) == ["late"]
    for number in range(10_001):
        failures.count(str(number), FAILURE_SECONDS + 1.0)
    failures.count("later", 2 * FAILURE_SECONDS)
    assert len(failures._times) == 10_002 and "late" not in failures._times
