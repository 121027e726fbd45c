"""`python -m rehyb` is `rehyb`."""

from rehyb.cli import main

main()
