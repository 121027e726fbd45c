"""A pilots file: which batch system starts workers, how large they are and how many."""

import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any
from unicodedata import category

from models.processes import python
from rehyb.durations import seconds
from rehyb.errors import Invalid
from rehyb.pilots.engines import ENGINES

#: Seconds of a pilot's walltime that are not its worker's: to load what it needs, and to end.
AROUND_SECONDS = 30.0
#: A year, in seconds: no batch system lets a job stay for longer, nor reads such a time.
LONGEST = 366 * 86400.0
#: No machine has as many cores, and no site as many pilots.
MOST = 100_000
#: Seconds of an instance below which a worker does not start (`worker.cli`).
SHORTEST_INSTANCE = 0.1
#: A worker needs so long to say goodbye (`worker.cli` refuses a shorter life).
SHORTEST_LIFE = 10.0


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a pilots file says."""

    #: A name of `ENGINES`.
    provider: str
    #: Seconds after which the batch system ends a pilot.
    walltime: float
    #: Cores of one pilot: so many instances run in it at once.
    cores: int
    #: Pilots that stay though there is no work, and the most there may be, waiting ones among them.
    minimum: int = 0
    maximum: int
    #: No more pilots than this are submitted within a minute.
    starts_a_minute: int = 10
    #: Seconds a pilot beyond the minimum waits for work before it leaves.
    idle: float = 60.0
    #: Seconds an instance may take before the worker kills it.
    instance: float = 120.0
    #: Lines of a shell script before the worker's.
    before: str = ""
    #: The worker and what else it is told. Default: that of this installation.
    worker: str = shlex.join(python("-m", "worker"))
    #: What else the provider of parsl takes: partition, account, scheduler_options.
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def lifetime(self) -> float:
        """Seconds that a pilot's worker may stay."""
        return self.walltime - AROUND_SECONDS


_TIMES = {"walltime", "idle", "instance"}
_COUNTS = {"cores": 1, "minimum": 0, "maximum": 1, "starts_a_minute": 1}
_TEXTS = {"provider", "before", "worker"}
_NEEDED = ("provider", "walltime", "cores", "maximum")
_KNOWN = [entry.name for entry in fields(Settings)]


def read(path: Path) -> Settings:
    """Return what a pilots file says.

    Raises:
        Invalid: it cannot be read, or asks for something that cannot be.
    """
    try:
        return checked(tomllib.loads(path.read_text()))
    except OSError as error:
        raise Invalid(f"{path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise Invalid(f"{path} is not TOML: {error}") from None
    except Invalid as error:
        raise Invalid(f"{path}: {error}") from None


def checked(content: Mapping[str, Any]) -> Settings:
    """Return the settings that the entries of a pilots file make.

    Raises:
        Invalid: an entry is unknown, missing or impossible.
    """
    for name in content:
        if name not in _KNOWN:
            raise Invalid(f"there is no entry {name!r}: the entries are {', '.join(_KNOWN)}")
    for name in _NEEDED:
        if name not in content:
            raise Invalid(f"{name} is missing")
    settings = Settings(**{name: _value(name, value) for name, value in content.items()})
    if settings.provider not in ENGINES:
        raise Invalid(f"there is no provider {settings.provider!r}: take {', '.join(ENGINES)}")
    if settings.minimum > settings.maximum:
        raise Invalid(f"minimum = {settings.minimum} is more than maximum = {settings.maximum}")
    if settings.lifetime < max(settings.instance, SHORTEST_LIFE):
        raise Invalid(
            f"walltime is {settings.walltime:g} s, of which {AROUND_SECONDS:g} s go into starting "
            f"and ending: that is too short for an instance, which may take {settings.instance:g} "
            "s (instance)"
        )
    return settings


def _value(name: str, value: Any) -> Any:
    """Return an entry's value as `Settings` has it."""
    if name in _TIMES:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise Invalid(f"{name} is a time like 90, '30m' or '2h', not {value!r}")
        found = seconds(str(value), name)
        if found > LONGEST:
            raise Invalid(f"{name} is a year at most, not {str(value)[:40]!r}")
        if name == "instance" and found < SHORTEST_INSTANCE:
            raise Invalid(
                f"instance is {SHORTEST_INSTANCE:g} s at least, or each would be killed as it "
                f"begins, not {str(value)[:40]!r}"
            )
        return found
    if name in _COUNTS:
        least = _COUNTS[name]
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= MOST:
            raise Invalid(f"{name} is a whole number from {least} to {MOST}, not {value!r}")
        return value
    if name in _TEXTS:
        if not isinstance(value, str):
            raise Invalid(f"{name} is a text in quotes, not {value!r}")
        _check_text(name, value)
        if name == "worker":
            _check_command(value)
        return value
    if not isinstance(value, dict):
        raise Invalid(f"{name} is a table, [{name}], not {value!r}")
    for option, said in value.items():
        if isinstance(said, str):
            _check_text(f"[{name}] {option}", said)
    return value


def _check_text(name: str, text: str) -> None:
    """Raise Invalid for a control character, which a shell or batch system reads as it likes."""
    for character in text:
        if category(character) == "Cc" and character not in "\n\t":
            raise Invalid(
                f"{name} has the control character {character!r}: it goes into a script, whose "
                "text has none but tabs and the ends of lines"
            )


def _check_command(worker: str) -> None:
    """Raise Invalid unless a worker's command is one line that a shell can take apart."""
    right = "it is the command of a worker on one line, as '/opt/rehyb/bin/rehyb-worker'"
    if not worker.strip() or "\n" in worker:
        raise Invalid(f"worker is {worker!r}: {right}; what comes before it is said as `before`")
    try:
        shlex.split(worker)
    except ValueError as error:
        raise Invalid(f"worker is {worker!r}: {right}, and this one has {error}") from None
