"""Traces by OpenTelemetry: of each study one, from its submission to its results.

Its spans come from several requests, often to several coordinators. None has to know the others:
the ids of a trace and of its spans are made of those of the study and of its leases.
"""

import logging
import os
import time
from contextvars import ContextVar
from hashlib import blake2b
from threading import Thread

from opentelemetry import trace
from opentelemetry.context import Context
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import ReadableSpan, TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SpanExporter
from opentelemetry.sdk.trace.id_generator import RandomIdGenerator
from opentelemetry.sdk.trace.sampling import Decision
from opentelemetry.trace import Link, NonRecordingSpan, SpanContext, TraceFlags
from opentelemetry.util.types import Attributes

from server.records import Lease, Study

log = logging.getLogger(__name__)

#: A coordinator that ends waits so long for who takes its traces; the exporter alone would wait
#: half a minute, in which nobody serves and whoever stops services kills it.
CLOSE_SECONDS = 3.0
#: Digits of a lease's id that say when it was granted, in microseconds (`leasing.new_id`).
_MOMENT = 16

_Ids = tuple[int, int]
_NEXT: ContextVar[_Ids | None] = ContextVar("_NEXT", default=None)


def provider(exporter: SpanExporter | None = None) -> TracerProvider:
    """Return what sends spans, set up by OTEL_... of the environment.

    Args:
        exporter: where spans go; None: to OTEL_EXPORTER_OTLP_ENDPOINT, by HTTP.
    """
    name = {} if os.environ.get("OTEL_SERVICE_NAME") else {"service.name": "rehyb-coordinator"}
    resource = Resource.create(name)
    found = TracerProvider(resource=resource, id_generator=_Generator(), shutdown_on_exit=False)
    found.add_span_processor(BatchSpanProcessor(exporter or OTLPSpanExporter()))
    return found


class Traces:
    """Tells of studies. Each method is called in the request that did what it tells."""

    def __init__(self, provider: TracerProvider) -> None:
        self.provider = provider
        self._tracer = provider.get_tracer("rehyb")

    def close(self) -> None:
        """Send what is left, as far as it is taken within CLOSE_SECONDS."""
        last = Thread(target=self.provider.shutdown, daemon=True)
        last.start()
        last.join(CLOSE_SECONDS)
        if last.is_alive():
            log.warning("nobody takes the last traces: they are lost")

    def submitted(self, study: Study) -> None:
        """Tell of a new study: the first span of its trace."""
        about: dict[str, str | int] = {
            "rehyb.study": study.id,
            "rehyb.model": study.plan.model,
            "rehyb.instances": study.plan.instances,
        }
        self._tell("submit", None, _of_study(study.id), about)

    def leased(self, lease: Lease) -> None:
        """Tell of a lease that was granted."""
        self._tell(
            "lease", self._context(lease.study), _of_lease(lease.study, lease.id), _about(lease)
        )

    def completed(self, study: str, lease: str, worker: str, results: int) -> None:
        """Tell of results that were accepted: how long after the lease they came, and of the post.

        Args:
            study: id of their study.
            lease: id of their lease, which is one of the coordinator's.
            worker: who brought them.
            results: how many.
        """
        under = self._context(study, lease)
        about: dict[str, str | int] = {
            "rehyb.study": study,
            "rehyb.lease": lease,
            "rehyb.worker": worker,
            "rehyb.results": results,
        }
        came = _began() or time.time_ns()
        granted = _granted(lease, came)
        run = self._tracer.start_span("run", under, start_time=granted, attributes=about)
        run.end(came)
        self._tell("complete", trace.set_span_in_context(run, under), None, about)

    def _tell(self, name: str, under: Context | None, ids: _Ids | None, about: Attributes) -> None:
        """Tell of what this request did, from when it came until now."""
        asked = trace.get_current_span().get_span_context()
        token = _NEXT.set(ids)
        try:
            span = self._tracer.start_span(
                name,
                Context() if under is None else under,
                attributes=about,
                links=[Link(asked)] if asked.is_valid else [],
                start_time=_began(),
            )
        finally:
            _NEXT.reset(token)
        span.end()

    def _context(self, study: str, lease: str | None = None) -> Context:
        """Return what stands above a span: the study's first one, or that of a lease."""
        number, span = _of_study(study) if lease is None else _of_lease(study, lease)
        # As it was decided, or would be, when the study was submitted.
        decided = self.provider.sampler.should_sample(None, number, "submit").decision
        flags = TraceFlags(decided == Decision.RECORD_AND_SAMPLE)
        above = SpanContext(number, span, is_remote=True, trace_flags=flags)
        return trace.set_span_in_context(NonRecordingSpan(above), Context())


class _Generator(RandomIdGenerator):
    """Makes the ids of spans that others must find, and any ids for the rest."""

    def generate_trace_id(self) -> int:
        chosen = _NEXT.get()
        return super().generate_trace_id() if chosen is None else chosen[0]

    def generate_span_id(self) -> int:
        chosen = _NEXT.get()
        return super().generate_span_id() if chosen is None else chosen[1]


def _about(lease: Lease) -> dict[str, str | int]:
    return {
        "rehyb.study": lease.study,
        "rehyb.lease": lease.id,
        "rehyb.worker": lease.worker,
        "rehyb.host": lease.host,
        "rehyb.instances": len(lease.instances),
    }


def _granted(lease: str, came: int) -> int:
    """Return when a lease was granted, in ns; if its id does not say so, when its results came."""
    try:
        return min(came, int(lease[:_MOMENT], 16) * 1000)
    except ValueError:
        return came


def _began() -> int | None:
    """Return when the request came, in ns; None if nobody traces it."""
    request = trace.get_current_span()
    return request.start_time if isinstance(request, ReadableSpan) else None


def _of_study(study: str) -> _Ids:
    return _number(f"study {study}", 16), _number(f"submit {study}", 8)


def _of_lease(study: str, lease: str) -> _Ids:
    return _of_study(study)[0], _number(f"lease {lease}", 8)


def _number(text: str, size: int) -> int:
    """Return a number made of a text; never 0, which stands for none."""
    return int.from_bytes(blake2b(text.encode(), digest_size=size).digest(), "big") or 1
