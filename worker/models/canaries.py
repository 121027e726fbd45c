"""What this machine computes at a few points of a model, found out beside the work.

Machines whose bits differ there are in different classes, so that no row of a study mixes them
(docs/understand/architecture.md, "Kinds of machines").
"""

import hashlib
import json
import logging
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from models.description import Description
from models.evaluation import NOT_DETERMINISTIC
from models.running.outcomes import Outcome
from models.running.place import Place
from models.running.pool import Pool

log = logging.getLogger(__name__)

#: Where in its range the second point has every factor: no round number.
OFF_NOMINAL = 0.381966
SEEDS = (1, 1, 2)


def points(description: Description) -> list[dict[str, float]]:
    """Return where a model is looked at: the nominal point, another, and the nominal one again."""
    nominal = {factor.name: factor.nominal for factor in description.factors}
    other = {
        factor.name: factor.nominal
        if factor.choices
        else factor.low + OFF_NOMINAL * (factor.high - factor.low)
        for factor in description.factors
    }
    return [nominal, other, nominal]


def digest_of(results: list[Mapping[str, Any]]) -> str:
    """Return a digest of the bits of some results."""
    said = [
        [result["outcome"], [float(value).hex() for value in result["outputs"].values()]]
        for result in results
    ]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:16]


@dataclass(kw_only=True)
class Canaries:
    """The canaries of the models that a worker has, each evaluated once."""

    #: One process, beside those that work.
    pool: Pool
    found: dict[str, str] = field(default_factory=dict)
    #: Models that this worker does not take, and why.
    refused: dict[str, str] = field(default_factory=dict)
    #: Those of them whose server does not answer, and may do so again.
    away: set[str] = field(default_factory=set)
    _waiting: deque[tuple[Description, Place]] = field(default_factory=deque)
    _asked: set[str] = field(default_factory=set)
    _results: list[Mapping[str, Any]] = field(default_factory=list)

    def of(self, description: Description, place: Place) -> str | None:
        """Return a model's canary; None: not yet, or never, since the model is refused.

        A model that says that it is not deterministic has an empty one.
        """
        if not description.deterministic:
            return ""
        version = description.version
        if version not in self._asked:
            self._asked.add(version)
            self._waiting.append((description, place))
        self.look()
        return self.found.get(version)

    def refuse(self, version: str, why: str) -> None:
        """Take nothing of a model, and say why."""
        log.error("does not take %s: %s", version, why)
        self.refused[version] = why

    def lose(self, version: str, why: str) -> None:
        """Take nothing of a model as long as its server does not answer."""
        if version not in self.refused:
            self.refuse(version, why)
            self.away.add(version)

    def find_again(self, version: str) -> None:
        """Take a model again whose server answers, once it is known what it computes now."""
        log.info("the server of %s answers again", version)
        self.away.discard(version)
        self.refused.pop(version, None)
        self.found.pop(version, None)
        self._asked.discard(version)

    def look(self) -> bool:
        """Go on with what was asked for; return whether a canary is still to be found."""
        self._go_on()
        return bool(self._waiting)

    def _go_on(self) -> None:
        """Begin the next evaluation, if the one before is done."""
        if self.pool.running:
            self._results += [done.result for done in self.pool.wait(0.0)]
        if self.pool.running or not self._waiting:
            return
        description, place = self._waiting[0]
        if len(self._results) == len(SEEDS) or self._says_enough():
            self._waiting.popleft()
            results, self._results = self._results, []
            self._judge(description.version, results)
            return
        number = len(self._results)
        self.pool.start(
            {
                "id": description.version,
                "model": description.version,
                "parameters": points(description)[number],
                "seed": SEEDS[number],
                "place": place,
                "time_limit": place.child_seconds,
            },
            None,
        )

    def _says_enough(self) -> bool:
        """Say whether no further point need be tried: the next would hang, or not load, either."""
        enough = (Outcome.BAD_MODEL, Outcome.TIMED_OUT, Outcome.AWAY)
        return any(result["outcome"] in enough for result in self._results)

    def _judge(self, version: str, results: list[Mapping[str, Any]]) -> None:
        if bad := next((r for r in results if r["outcome"] == Outcome.BAD_MODEL), None):
            self.refuse(version, f"it cannot be loaded here: {bad['reason']}")
            return
        if away := next((r for r in results if r["outcome"] == Outcome.AWAY), None):
            self.lose(version, away["reason"])
            return
        first, again = results[0], results[-1]
        whole = len(results) == len(SEEDS)
        if (
            whole
            and first["outputs"]
            and again["outputs"]
            and digest_of([first]) != digest_of([again])
        ):
            self.refuse(version, NOT_DETERMINISTIC)
            return
        self.found[version] = digest_of(results[:2])
        log.info("has the model %s, canary %s", version, self.found[version])
