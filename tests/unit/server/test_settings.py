"""What an operator decides."""

import pytest
from pydantic import ValidationError

from server.settings import Settings


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
