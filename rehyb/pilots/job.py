"""What a pilot's job runs, and the folder in which it finds what it needs."""

import shlex
from math import ceil
from pathlib import Path

from rehyb.pilots.marks import TOUCH_SECONDS
from rehyb.pilots.settings import Settings

#: What is in a keeper's folder; TICKETS is a folder with a file for each pilot that is wanted, and
#: MARKS one with a file for each that is there.
ENVIRONMENT, TICKETS, MARKS, JOB = "environment", "tickets", "marks", "pilot.sh"

#: What a job runs. A worker is asked to drain by a file that goes, in every batch system alike: not
#: each of them passes signals on, and some kill soon after. Who has no ticket is not counted: a
#: batch system may take a job and say that it did not.
_SCRIPT = """#!/bin/sh
# Written by rehyb pilots.
# $1: its ticket; $2: seconds to wait; the rest: what the worker is told besides.
cd {folder} || exit 1
. ./{environment}
ticket={tickets}/$1
mark={marks}/$1
sleep "$2"
shift 2
# Opened, since a network's folder may be remembered as it was.
wanted() {{ true < "$ticket"; }} 2>/dev/null
beats=0
beat() {{
    beats=$((beats + 1))
    [ $((beats % {touch})) -ne 0 ] || touch "$mark" 2>/dev/null
    sleep 1
}}
# First the mark: who takes the ticket away and finds no mark knows that this one will not work.
trap 'rm -f "$mark"' EXIT
touch "$mark" 2>/dev/null
wanted || exit 0
{worker} "$@" &
worker=$!
# A shell that is killed alone leaves its worker behind, which nobody would count: this one has the
# worker leave, and counts it meanwhile; until it must be gone, since some containers bury no dead.
(
    trap '' TERM INT
    while kill -0 $$; do sleep 1; done
    kill -TERM "$worker"
    touch "$mark"
    while kill -0 "$worker" && [ "$beats" -lt {lifetime} ]; do beat; done
    rm -f "$mark"
) > /dev/null 2>&1 &
guard=$!
trap 'kill -KILL "$guard"; rm -f "$mark"' EXIT
leave() {{
    trap '' TERM INT
    kill -TERM "$worker" 2>/dev/null
    while kill -0 "$worker" 2>/dev/null; do beat; done
    wait "$worker"
    exit
}}
trap leave TERM INT
while kill -0 "$worker" 2>/dev/null; do
    wanted || leave
    beat
done
wait "$worker"
status=$?
# It left by itself: whoever was told to may be queued again by the batch system, and needs it then.
rm -f "$ticket"
exit "$status"
"""


def script(settings: Settings, folder: Path) -> str:
    """Return the script of the pilots of a keeper's folder."""
    worker = (
        f"{settings.worker} --processes {settings.cores} --lifetime {digits(settings.lifetime)} "
        f"--instance-seconds {digits(settings.instance)}"
    )
    return _SCRIPT.format(
        folder=shlex.quote(str(folder)),
        environment=ENVIRONMENT,
        tickets=TICKETS,
        marks=MARKS,
        touch=TOUCH_SECONDS,
        lifetime=ceil(settings.lifetime),
        worker=worker,
    )


def digits(seconds: float) -> str:
    """Write a time without an exponent, which a worker does not take."""
    return f"{seconds:.3f}".rstrip("0").rstrip(".")
