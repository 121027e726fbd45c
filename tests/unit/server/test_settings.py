"""What an operator decides."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from server.settings import Settings, objection


@pytest.fixture(autouse=True)
def _clean(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in Settings.model_fields:
        monkeypatch.delenv(f"REHYB_{name.upper()}", raising=False)


def test_only_the_token_must_be_given(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValidationError, match="every request to /v1 must bear"):
        Settings()
    monkeypatch.setenv("REHYB_TOKEN", "secret")
    settings = Settings()
    assert settings.token.get_secret_value() == "secret"
    assert settings.database_url == "sqlite:///rehyb.sqlite3"
    assert (settings.host, settings.port, settings.lease_seconds) == ("127.0.0.1", 8787, 60.0)


def test_the_environment_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {
        "TOKEN": "t",
        "DATABASE_URL": "sqlite:///x.db",
        "HOST": "::1",
        "PORT": "0",
        "LEASE_SECONDS": "2.5",
    }
    for name, value in values.items():
        monkeypatch.setenv(f"REHYB_{name}", value)
    settings = Settings()
    assert (settings.database_url, settings.host) == ("sqlite:///x.db", "::1")
    assert (settings.port, settings.lease_seconds) == (0, 2.5)


@pytest.mark.parametrize(
    ("name", "value"),
    [("PORT", "-1"), ("PORT", "65536"), ("LEASE_SECONDS", "0"), ("TOKEN", "")],
)
def test_settings_out_of_range_are_refused(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "t")
    monkeypatch.setenv(f"REHYB_{name}", value)
    with pytest.raises(ValidationError):
        Settings()


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        (
            "LEASE_SECONDS",
            "nan",
            "REHYB_LEASE_SECONDS must be seconds, a number above 0 and 86400 at most, as 60, not "
            "'nan'",
        ),
        (
            "HOST",
            "",
            "REHYB_HOST must be an address or name of this machine, as 127.0.0.1, or 0.0.0.0 for "
            "all of them, not ''",
        ),
        ("PORT", "http", "REHYB_PORT must be a whole number up to 65535, not 'http'"),
        (
            "RECOMPUTE_SHARE",
            "",
            "REHYB_RECOMPUTE_SHARE must be a number from 0 to 1, as 0.01, not ''",
        ),
        ("TOKEN", "", "REHYB_TOKEN: set it to a secret that every request to /v1 must bear"),
        ("TLS_KEY", "k", "TLS needs both REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY"),
    ],
)
def test_what_is_wrong_with_a_setting_is_a_sentence_that_says_what_is_right(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, sentence: str
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "hush")
    monkeypatch.setenv(f"REHYB_{name}", value)
    with pytest.raises(ValidationError) as refused:
        Settings()
    assert objection(refused.value) == sentence


def test_all_that_is_wrong_with_settings_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("REHYB_TOKEN", raising=False)
    monkeypatch.setenv("REHYB_LEASE_SECONDS", "-1")
    with pytest.raises(ValidationError) as refused:
        Settings()
    assert objection(refused.value) == (
        "REHYB_TOKEN: set it to a secret that every request to /v1 must bear; REHYB_LEASE_SECONDS "
        "must be seconds, a number above 0 and 86400 at most, as 60, not '-1'"
    )


def test_what_a_setting_of_numbers_and_words_must_be_is_said_of_each() -> None:
    free = {"database_url", "token", "tls_certificate", "tls_key"}
    said = {name for name, field in Settings.model_fields.items() if field.description}
    assert said == Settings.model_fields.keys() - free


def test_the_token_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "hush")
    assert "hush" not in repr(Settings())


def test_a_token_from_a_file_may_end_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "secret\r\n")
    assert Settings().token.get_secret_value() == "secret"


@pytest.mark.parametrize("token", ["hush hush", "h\xfcsh", "hush\udcff"])
def test_a_token_that_no_request_can_bear_is_refused_and_not_shown(
    monkeypatch: pytest.MonkeyPatch, token: str
) -> None:
    monkeypatch.setenv("REHYB_TOKEN", token)
    with pytest.raises(ValidationError, match="no request can bear") as refused:
        Settings()
    assert "hush" not in str(refused.value) and "h\xfcsh" not in str(refused.value)


def test_tls_needs_certificate_and_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REHYB_TOKEN", "t")
    monkeypatch.setenv("REHYB_TLS_KEY", "key.pem")
    with pytest.raises(ValidationError, match="both REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY"):
        Settings()


def test_a_file_that_is_no_certificate_or_key_is_named_with_its_variable(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    certificate, key = tmp_path / "c.pem", tmp_path / "k.pem"
    monkeypatch.setenv("REHYB_TOKEN", "t")
    monkeypatch.setenv("REHYB_TLS_CERTIFICATE", str(certificate))
    monkeypatch.setenv("REHYB_TLS_KEY", str(key))

    def said() -> str:
        with pytest.raises(ValidationError) as refused:
            Settings()
        return refused.value.errors()[0]["msg"].removeprefix("Value error, ")

    assert said() == f"REHYB_TLS_KEY: {key} cannot be read: No such file or directory"
    for kind in ("ENCRYPTED PRIVATE KEY", "RSA PRIVATE KEY"):
        # Of both ways in which a password is written.
        header = "\nProc-Type: 4,ENCRYPTED" if kind.startswith("RSA") else ""
        key.write_text(f"-----BEGIN {kind}-----{header}\nAAAA\n-----END {kind}-----\n")
        certificate.write_text(key.read_text().replace(kind, "CERTIFICATE"))
        assert said().startswith(f"REHYB_TLS_KEY: {key} has a password, which nobody could be")
    key.write_text("-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n")
    certificate.write_bytes(b"\xff\x00")
    assert said() == f"REHYB_TLS_CERTIFICATE: {certificate} is no PEM file with a certificate"
    certificate.write_text(key.read_text().replace("PRIVATE KEY", "CERTIFICATE"))
    assert said().startswith(
        "REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY must be a certificate and its own key; "
        f"{certificate} and {key} are not: "
    )
