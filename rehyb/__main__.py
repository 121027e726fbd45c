"""`python -m rehyb` is `rehyb`."""

import sys
from pathlib import Path

# `python -m` looks first in the folder that it runs in, where a user's own sim.py would be taken
# for ours; unless rehyb itself is there.
_HERE = Path.cwd()
if not sys.flags.safe_path and sys.path[:1] == [str(_HERE)] and _HERE not in Path(__file__).parents:
    del sys.path[0]

from rehyb.cli import main  # noqa: E402

main()
