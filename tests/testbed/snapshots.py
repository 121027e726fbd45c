"""Snapshots of studies that were never run, for tests of what is decided from them."""

from typing import Any


def interval(value: float | None, half: float) -> dict[str, float | None]:
    """Return an index with an interval of this half width; without a value, of one unknown."""
    if value is None:
        return {"value": None, "low": None, "high": None}
    return {"value": value, "low": value - half, "high": value + half}


def snapshot(half: float, *, sampling: str = "sobol", rows: int = 300) -> dict[str, Any]:
    """Return one of two factors, of which ST of x has the widest interval."""
    factors = {
        "x": {"first_order": interval(0.3, 0.01), "total_order": interval(0.5, half), "n": rows},
        "y": {"first_order": interval(0.2, 0.01), "total_order": interval(0.4, 0.01), "n": rows},
    }
    return {
        "method": "saltelli",
        "sampling": sampling,
        "rows_complete": rows,
        "evaluations": {"ok": 4 * rows},
        "outputs": {"error": {"factors": factors}},
    }


def fitted(half: float, rows: int, *, explained: float = 0.99, doubt: str = "") -> dict[str, Any]:
    """Return a snapshot of a study of method surrogate."""
    found = snapshot(half, sampling="owen_blocks", rows=rows)
    found["method"] = "surrogate"
    found["outputs"]["error"] |= {
        "surrogate": {"kind": "gaussian process", "runs": rows, "explained": explained},
        "trust": {
            "runs": rows,
            "unseen": 3.0 / rows,
            "trusted": None if rows < 256 else not doubt,
            "sentence": doubt,
        },
    }
    return found
