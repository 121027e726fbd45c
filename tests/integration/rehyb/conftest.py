"""The `rehyb` command in this process."""

from tests.testbed.command import run as run
from tests.testbed.command import talk_to as talk_to
