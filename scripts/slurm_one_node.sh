#!/usr/bin/env bash
# Starts Slurm with this machine as its only node, to try `rehyb pilots` on the real thing.
# Debian's slurm-wlm and munge; root, and no control groups needed: a container will do.
#
#   scripts/slurm_one_node.sh start FOLDER    installs what is missing, writes FOLDER/slurm.conf
#   scripts/slurm_one_node.sh stop FOLDER
#
# Afterwards: export SLURM_CONF=FOLDER/slurm.conf
set -euo pipefail

[ $# = 2 ] || { sed -n '2,9s/^# \{0,1\}//p' "$0" >&2; exit 2; }
mkdir -p "$2"
folder=$(cd "$2" && pwd)
export SLURM_CONF=$folder/slurm.conf

stop() {
    for daemon in slurmctld slurmd munged; do
        if [ -s "$folder/$daemon.pid" ]; then
            kill "$(cat "$folder/$daemon.pid")" 2>/dev/null || true
        fi
    done
}

start() {
    command -v slurmctld slurmd munged >/dev/null ||
        DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends slurm-wlm munge
    mkdir -p "$folder/state" "$folder/spool"
    [ -s "$folder/munge.key" ] || head -c 1024 /dev/urandom >"$folder/munge.key"
    # Munge wants its files to itself.
    chmod 600 "$folder/munge.key"
    munged --force --key-file "$folder/munge.key" --socket "$folder/munge.socket" \
        --pid-file "$folder/munged.pid" --log-file "$folder/munged.log" \
        --seed-file "$folder/munged.seed"
    port=${REHYB_SLURM_PORT:-16817}
    cat >"$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
SlurmUser=root
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=2,batch_sched_delay=0,sched_min_interval=0
# Soon, because somebody waits; and what cannot run is refused when it is submitted.
KillWait=10
OverTimeLimit=0
EnforcePartLimits=ALL
ReturnToService=2
MpiDefault=none
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=day Nodes=ALL Default=YES MaxTime=24:00:00 State=UP
CONF
    slurmctld
    slurmd
    for _ in $(seq 60); do
        [ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ] && return
        sleep 0.5
    done
    echo "the node did not become idle: see $folder/slurmctld.log and slurmd.log" >&2
    tail -5 "$folder/slurmctld.log" "$folder/slurmd.log" >&2
    exit 1
}

case $1 in
    start) start ;;
    stop) stop ;;
    *) echo "start or stop, not $1" >&2; exit 2 ;;
esac
