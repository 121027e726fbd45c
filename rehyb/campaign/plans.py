"""What a campaign computes, and sizes by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from models.description import Description


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a campaign computes; the same plan resumes the same campaign."""

    model: str
    #: The output whose uncertainty is ranked.
    output: str
    #: Rows of phase 1, each of k + 1 instances (r in the paper).
    screening_rows: int
    #: Rows of phase 2, each of k + 1 instances for the k - 1 factors left (N in the paper).
    variance_rows: int
    sampling: str = "owen_blocks"
    seed: int = 1
    #: Phase 2 is extended up to this many rows until every interval of its indices is within
    #: +-`target` (default 0.02); None: it has `variance_rows` and no more.
    most_rows: int | None = None
    target: float | None = None
    #: Values that other factors keep throughout, and the ranges of the arm's lengths: a key of
    #: `sim.parameters.wearer.RANGES`.
    fixed: Mapping[str, float] = field(default_factory=dict)
    ranges: str = "table_1"
    #: Whether `fixed` may lie far outside what a factor was validated for.
    outside_range: bool = False
    #: Description of a model that does not come with rehyb, as JSON.
    described: Mapping[str, Any] | None = None

    @property
    def description(self) -> "Description":
        """The model's factors and outputs."""
        from models.built_in import built_in_models
        from models.description import Description

        if self.described is None:
            return built_in_models()[self.model]
        return Description.from_json(self.described, kept=True)


#: Sizes of a campaign: fields of a plan.
PRESETS: Mapping[str, Mapping[str, Any]] = {
    # Minutes on a laptop. At this size scrambled Sobol points are several times more precise.
    "demo": {"screening_rows": 16, "variance_rows": 64, "sampling": "owen_blocks"},
    # Sections 3.1 and 3.2.
    "paper": {"screening_rows": 150, "variance_rows": 3000, "sampling": "latin_hypercube"},
}
