"""How intervals fare against functions that were written to deceive them.

The studies and the table are `benchmarks.sensitivity.hard`'s, the functions those of
`tests.testbed.functions.opponents`, on which nothing was set. `make bench-analysis` prints it,
`python -m benchmarks.sensitivity.opponents [SEEDS] [FIRST SEED]` this alone.
"""

import sys

from benchmarks.sensitivity.coverage import FIRST_SEED
from benchmarks.sensitivity.hard import print_hard
from tests.testbed.functions.opponents import OPPONENTS


def main() -> None:
    """Print the tables."""
    asked = [int(one) for one in sys.argv[1:]]
    seeds, first = asked + [100, FIRST_SEED][len(asked) :]
    print_hard(range(first, first + seeds), OPPONENTS)


if __name__ == "__main__":
    main()
