"""What interpreting promises to the readers of its report: its files, and which code made it.

Cheap to import: a coordinator or a client learns it without NumPy.
"""

import hashlib

from analysis.closeloop.code import digest

#: What a report consists of.
REPORT_FILES = ("report.json", "report.html")
#: Factors that may be known of one patient.
MOST_KNOWN = 64


def code(bank: str) -> str:
    """Return a digest of the sources and the bank that an answer depends on, 16 digits.

    Args:
        bank: its id.
    """
    own = digest("closeloop", "interpretation")
    return hashlib.sha256(f"{own} {bank}".encode()).hexdigest()[:16]
