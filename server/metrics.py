"""What a Prometheus server may scrape: gauges read from the database, counters of this process."""

from collections.abc import Callable, Iterable

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily, Metric
from sqlalchemy.engine import Engine

from server.logic.fleet.hosts import GONE_SECONDS
from server.store import gauges
from server.store.database.engine import reading

#: Seconds: from a closed form to an assessment on a slow machine, or one that hangs.
RUN_BUCKETS = (0.001, 0.01, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 15.0, 60.0, 300.0)

#: Seconds: of a transaction, and of many that wait for each other.
LEASE_BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 5.0)


class Metrics:
    """The metrics of one coordinator.

    Labels take few values only: states, verdicts and outcomes, never a study or a worker.
    """

    def __init__(self, engine: Engine, clock: Callable[[], float]) -> None:
        self.registry = CollectorRegistry()
        self.registry.register(_Stored(engine, clock))
        self.leases = Counter("rehyb_leases_granted", "Leases granted", registry=self.registry)
        self.misfits = Counter(
            "rehyb_misfits", "Requests for work by workers that fit none", registry=self.registry
        )
        self.lost = Counter(
            "rehyb_lost", "Instances taken back from silent workers", registry=self.registry
        )
        self.freed = Counter(
            "rehyb_rows_freed", "Rows begun anew on another kind of machine", registry=self.registry
        )
        self.verdicts = Counter(
            "rehyb_verdicts", "Results posted, by verdict", ["verdict"], registry=self.registry
        )
        self.lease_seconds = Histogram(
            "rehyb_lease_seconds",
            "Time it took to answer a worker that asked for work",
            buckets=LEASE_BUCKETS,
            registry=self.registry,
        )
        self.run_seconds = Histogram(
            "rehyb_run_seconds",
            "Wall time of accepted instances",
            buckets=RUN_BUCKETS,
            registry=self.registry,
        )


class _Stored:
    """Gauges that are counted when somebody looks."""

    def __init__(self, engine: Engine, clock: Callable[[], float]) -> None:
        self._engine = engine
        self._clock = clock

    def collect(self) -> Iterable[Metric]:
        moment = self._clock()
        with reading(self._engine) as connection:
            now = gauges.read(connection, now=moment, heard_after=moment - GONE_SECONDS)
        yield _family("rehyb_studies", "Studies by state", "state", now.studies)
        yield _family("rehyb_instances", "Instances of studies under way", "state", now.instances)
        yield _family("rehyb_failures", "Final failures by outcome", "outcome", now.failures)
        yield _family("rehyb_comparisons", "Second opinions by state", "state", now.comparisons)
        yield _family("rehyb_close_loops", "Closing the loop, by state", "state", now.close_loops)
        for name, text, value in (
            ("rehyb_workers", "Workers heard of within a minute", now.workers),
            ("rehyb_open_leases", "Leases held by workers", now.open_leases),
            ("rehyb_oldest_lease_seconds", "Age of the oldest open lease", now.oldest_lease),
            ("rehyb_analysis_lag", "Results the analysis has not taken in", now.lag),
        ):
            yield GaugeMetricFamily(name, text, value=value)


def _family(name: str, text: str, label: str, values: dict[str, int]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in sorted(values.items()):
        family.add_metric([key], value)
    return family
