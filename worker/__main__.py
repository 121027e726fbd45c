"""`python -m worker` is `rehyb-worker`."""

from worker.cli import main

# Child processes import this module under another name when they start.
if __name__ == "__main__":
    main()
