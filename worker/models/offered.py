"""Which models this worker asks work for."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from models.description import Description, Kind
from models.running.places import NoModelError, Places
from rehyb.client import Client, Json
from rehyb.client.models import description_of
from rehyb.errors import Invalid, RehybError, ServerError, Unreachable
from sim.models import MODELS
from worker.models.canaries import Canaries

log = logging.getLogger(__name__)

#: Seconds between two looks at which uploaded models are wanted.
LOOK_SECONDS = 2.0
#: How a worker's owner names code, by the kind of model.
_OPTION = {
    Kind.COMMAND: "--models DIR",
    Kind.PYTHON: "--allow NAME",
    Kind.UMBRIDGE: "--models DIR --umbridge URL",
}
#: Models that a worker tells of at most: a coordinator takes no more of one.
MOST_MODELS = 100
OTHER_VERSION = (
    "it was started with another version of it: start it again if that is what its folder holds now"
)
#: Refused models that are told, and characters of why: a coordinator takes no more.
MOST_REFUSED, MOST_SAID = 20, 300


@dataclass(kw_only=True)
class WorkerModels:
    """The models that this worker has: rehyb's own, those that its owner named, and uploaded ones.

    One that is not rehyb's own is asked work for once its canary is known.
    """

    client: Client
    #: Id of this worker.
    worker: str
    places: Places
    canaries: Canaries
    #: Versions of rehyb's own, by which a coordinator knows one that has other factors there.
    own: Sequence[str] = ()
    _announced: bool = False
    #: Versions of which was said that this worker takes nothing.
    _told: set[str] = field(default_factory=set)
    _wanted: dict[str, Description] = field(default_factory=dict)
    #: Versions of which there are open studies, whatever their kind.
    _open: set[str] = field(default_factory=set)
    _look_at: float = 0.0

    def __post_init__(self) -> None:
        #: Those that its owner named.
        self._named = dict(self.places.descriptions)
        # Rehyb's own are told of by name and by version.
        most = MOST_MODELS - 2 * len(MODELS)
        if len(self._named) > most:
            raise Invalid(
                f"--models and --allow name {len(self._named)} models, and one worker takes {most} "
                "beside rehyb's own: start another worker for the rest"
            )
        #: How many of open studies' models it may have besides.
        self._room = most - len(self._named)

    def offered(self, now: float) -> Mapping[str, str]:
        """Return what to ask work for, each with its canary; now and then, look what is wanted.

        The coordinator is told first of the models whose code is here.

        Raises:
            RehybError: it does not answer, or does not take one of them.
        """
        if not self._announced:
            for description in self._named.values():
                if description.kind != Kind.MJCF:
                    self.client.announce_model(description.as_json(), self.worker)
            self._announced = True
        if now >= self._look_at:
            self._look_at = now + LOOK_SECONDS
            wanted = self.client.models(wanted=True)
            self._wanted = {
                _version(model): description_of(model)
                for model in wanted[: self._room]
                if model["kind"] == Kind.MJCF
            }
            self._open = {_version(model) for model in wanted}
            self._tell_of_code(wanted)
            self._find_again()
        offered = dict.fromkeys((*MODELS, *self.own), "")
        for version, description in (self._named | self._wanted).items():
            if version in self.canaries.refused:
                continue
            try:
                canary = self.canaries.of(description, self.places.place(version))
            except (Unreachable, ServerError):
                raise
            except (RehybError, NoModelError) as error:
                self.canaries.refuse(version, str(error))
                continue
            if canary is not None:
                offered[version] = canary
        return offered

    def refused(self) -> Mapping[str, str]:
        """Return which models this worker does not take, each with a line that says why.

        Of many those for which studies wait, and the latest.
        """
        versions = sorted(self.canaries.refused, key=lambda version: version in self._open)
        told = versions[-MOST_REFUSED:]
        return {version: _line(self.canaries.refused[version]) for version in told}

    def _find_again(self) -> None:
        """Take models again whose servers were away and are not any more."""
        if not self.canaries.away:
            return
        from models.umbridge.client import answers

        at = {version: self.places.place(version).url for version in self.canaries.away}
        # Of many models each server is asked once: one that is off lets who asks wait.
        there = {url for url in set(at.values()) if answers(url)}
        for version, url in at.items():
            if url in there:
                self.canaries.find_again(version)

    def _tell_of_code(self, wanted: Sequence[Json]) -> None:
        """Say once of each model of open studies whose code is not here that it is not."""
        names = {one.name for one in self._named.values()}
        for model in wanted:
            version = _version(model)
            if model["kind"] == Kind.MJCF or version in self._named or version in self._told:
                continue
            self._told.add(version)
            if model["name"] in names:
                self.canaries.refuse(version, OTHER_VERSION)
                continue
            why = f"its code is not here; whoever has it names it with {_OPTION[model['kind']]}"
            log.info("takes nothing of studies of %s: %s", version, why)


def _line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text[:MOST_SAID])


def _version(model: Json) -> str:
    return f"{model['name']}@{model['digest']}"
