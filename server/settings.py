"""What an operator decides about a coordinator, from the environment: REHYB_TOKEN and the like."""

import ssl
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, SecretStr, ValidationError, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from models.tokens import usable

#: What `host` must be.
AN_ADDRESS = "an address or name of this machine, as 127.0.0.1, or 0.0.0.0 for all of them"


class Settings(BaseSettings):
    """Settings of one coordinator; each is read from the environment with the prefix REHYB_."""

    model_config = SettingsConfigDict(
        env_prefix="REHYB_", frozen=True, extra="ignore", hide_input_in_errors=True
    )

    #: SQLAlchemy URL of the database: sqlite:///FILE or postgresql+psycopg://USER@HOST/NAME.
    database_url: str = "sqlite:///rehyb.sqlite3"
    #: What every request to /v1 must bear. It must be given: a coordinator is never open.
    token: SecretStr = Field(default=SecretStr(""), validate_default=True)
    #: Address to listen on. An empty one would be every one, which nobody means by it.
    host: str = Field(
        default="127.0.0.1",
        min_length=1,
        description=AN_ADDRESS,
    )
    #: Port to listen on; 0 takes any free one.
    port: int = Field(default=8787, ge=0, le=65535, description="a whole number up to 65535")
    #: Seconds a lease lasts unless its worker is heard from.
    lease_seconds: float = Field(
        default=60.0,
        gt=0.0,
        le=86400.0,
        description="seconds, a number above 0 and 86400 at most, as 60",
    )

    #: "full": nothing that a worker was told is safe is lost with the power; "normal": with SQLite,
    #: and with a PostgreSQL whose synchronous_commit is off, the last moments may be, and are
    #: computed again.
    durability: Literal["normal", "full"] = Field(default="normal", description="normal or full")

    #: Seconds that a begun row waits for its kind of machine before another begins it anew.
    stranded_seconds: float = Field(
        default=3600.0, gt=0.0, description="seconds, a number above 0, as 3600"
    )

    #: Share of the results that another host computes again; 0: none.
    recompute_share: float = Field(
        default=0.01, ge=0.0, le=1.0, description="a number from 0 to 1, as 0.01"
    )
    #: Relative difference of an output at which two hosts still agree. Machines of one kind agree
    #: to the last bit; between kinds, gaining or losing a contact amplifies the last bits.
    recompute_tolerance: float = Field(
        default=1e-3, ge=0.0, allow_inf_nan=False, description="a number from 0 on, as 0.001"
    )

    #: Largest zip file of a measured session, bytes; and of what closing the loop on it finds.
    session_bytes: int = Field(
        default=200_000_000, ge=1_000, description="bytes, a whole number from 1000 on"
    )

    #: The least of what is logged.
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="warning", description="debug, info, warning or error"
    )
    #: Files with a certificate and its key (PEM): with both, the coordinator speaks TLS only.
    tls_certificate: str | None = None
    tls_key: str | None = None

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if (self.tls_certificate is None) != (self.tls_key is None):
            raise ValueError("TLS needs both REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY")
        if self.tls_certificate is not None and self.tls_key is not None:
            _check_tls(self.tls_certificate, self.tls_key)
        return self

    @field_validator("token", mode="before")
    @classmethod
    def _is_given(cls, token: str | SecretStr) -> SecretStr:
        found = usable(token if isinstance(token, str) else token.get_secret_value())
        if not found:
            raise ValueError("set it to a secret that every request to /v1 must bear")
        return SecretStr(found)


def objection(error: ValidationError) -> str:
    """Say what is wrong with settings, and what would be right."""
    return "; ".join(map(_objection, error.errors()))


def _objection(fault: Any) -> str:
    if not fault["loc"]:
        # What concerns several settings has no place of its own, and names them itself.
        return str(fault["msg"]).removeprefix("Value error, ")
    field = str(fault["loc"][0])
    name, right = f"REHYB_{field}".upper(), Settings.model_fields[field].description
    if right is None:
        return f"{name}: {fault['msg'].removeprefix('Value error, ')}"
    return f"{name} must be {right}, not {str(fault['input'])[:40]!r}"


def _check_tls(certificate: str, key: str) -> None:
    """Raise ValueError unless files hold a certificate and its key, for which no one is asked."""
    found = _pem("REHYB_TLS_KEY", key, "PRIVATE KEY")
    _pem("REHYB_TLS_CERTIFICATE", certificate, "CERTIFICATE")
    if "ENCRYPTED" in found:
        # Whoever starts a service is not there to be asked.
        raise ValueError(
            f"REHYB_TLS_KEY: {key} has a password, which nobody could be asked for: write it "
            "without one by `openssl pkey -in KEY -out FILE`"
        )
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except ssl.SSLError as error:
        raise ValueError(
            "REHYB_TLS_CERTIFICATE and REHYB_TLS_KEY must be a certificate and its own key; "
            f"{certificate} and {key} are not: {error.reason or error}"
        ) from None


def _pem(variable: str, file: str, what: str) -> str:
    """Return the text of a PEM file; ValueError if it is none."""
    try:
        text = Path(file).read_text(errors="replace")
    except OSError as error:
        raise ValueError(f"{variable}: {file} cannot be read: {error.strerror}") from None
    if f"{what}-----" not in text:
        raise ValueError(f"{variable}: {file} is no PEM file with a {what.lower()}")
    return text
