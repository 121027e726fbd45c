"""A recording as a robot wrote it: channels with names, on one clock or several."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

#: Why what runs code where it is read is not read.
A_PICKLE = (
    "is a pickle, which is refused on purpose: whoever reads one runs the code in it; "
    "where it was written, save its arrays by numpy.savez, or its table by to_csv"
)


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One signal of a log."""

    #: As the log names it; "column 3" where it has no names.
    name: str
    #: As recorded, in the log's own unit; NaN where a sample is missing; shape (n,).
    values: Numbers
    #: Seconds on the log's clock, shape (n,); None where the log does not say.
    time: Numbers | None = None
    #: Where the log's kind says it; None otherwise.
    unit: str | None = None
    #: What the trials in it are called and the sample at which each begins; none if it is one.
    trials: tuple[tuple[str, int], ...] = ()


@dataclass(kw_only=True)
class Log:
    """What one file holds."""

    #: "CSV", "MATLAB", "NumPy", "JSON", "HDF5" or "ROS bag".
    kind: str
    channels: list[Channel] = field(default_factory=list)
    #: What was odd about the file, in sentences.
    remarks: list[str] = field(default_factory=list)
