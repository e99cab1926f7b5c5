#!/bin/bash
# Start a private one-node SLURM for tests: munged, slurmctld and slurmd on loopback, without systemd or
# cgroups, with nothing read from or written to /etc. Run as root, with SLURM_TEST_DIR set to an empty
# folder; then `. $SLURM_TEST_DIR/env.sh`. stop.sh ends it.
#
#     SLURM_TEST_CPUS=2            processors that the node claims; they need not exist
#     SLURM_TEST_MAX_ARRAY=10001   MaxArraySize
#     SLURM_TEST_PORT=16817        slurmctld's port, and slurmd's is the next
#     KEEP_STATE=1                 go on with the queue of the last time
set -u
dir=${SLURM_TEST_DIR:?set SLURM_TEST_DIR to an empty folder}
port=${SLURM_TEST_PORT:-16817}
here=$(cd "$(dirname "$0")" && pwd)
host=$(hostname -s)
memory=$(awk '/MemTotal/ { print int($2 / 1024) }' /proc/meminfo)
export PATH=/usr/sbin:/usr/bin:/sbin:/bin:$PATH
export SLURM_CONF=$dir/etc/slurm.conf

# To kill -0 a zombie lives, and in a container it may never be reaped.
alive() { [ -s "$1" ] && grep -q '^State:[[:space:]]*[^ZX[:space:]]' "/proc/$(cat "$1")/status" 2>/dev/null; }

fail() {
    echo "start.sh: $*" >&2
    tail -n 5 "$dir"/log/*d.log >&2
    "$here/stop.sh"
    exit 1
}

for daemon in munged slurmctld slurmd; do
    if alive "$dir/run/$daemon.pid"; then
        echo "start.sh: $daemon runs already in $dir; run stop.sh first" >&2
        exit 1
    fi
done
[ "${KEEP_STATE:-0}" = 1 ] || rm -rf "$dir/state" "$dir/spool" "$dir/log" "$dir/run"
umask 022
mkdir -p "$dir"/{etc,run,state,spool,log,munge}
chmod 755 "$dir" "$dir/run"
chmod 700 "$dir/munge" "$dir/state"
[ -s "$dir/munge/munge.key" ] ||
    (umask 077 && dd if=/dev/urandom of="$dir/munge/munge.key" bs=128 count=1 status=none)

cat >"$SLURM_CONF" <<END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=$port
SlurmdPort=$((port + 1))
# 127.0.0.1 instead of 0.0.0.0
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
AuthType=auth/munge
AuthInfo=socket=$dir/run/munge.socket,cred_expire=5
CredType=cred/munge
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/run/slurmctld.pid
SlurmdPidFile=$dir/run/slurmd.pid
SlurmctldLogFile=$dir/log/slurmctld.log
SlurmdLogFile=$dir/log/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
MailProg=/bin/true
SwitchType=switch/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc=$dir/log/jobcomp.log
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0,bf_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
PriorityType=priority/basic
# Short, for tests.
MinJobAge=3600
KillWait=2
SlurmctldTimeout=10
SlurmdTimeout=30
InactiveLimit=0
Waittime=0
CompleteWait=0
JobRequeue=1
ReturnToService=2
MaxArraySize=${SLURM_TEST_MAX_ARRAY:-10001}
SlurmdParameters=config_overrides
NodeName=$host NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=${SLURM_TEST_CPUS:-2} RealMemory=$memory State=UNKNOWN
PartitionName=debug Nodes=$host Default=YES MaxTime=INFINITE DefaultTime=60 State=UP OverSubscribe=NO
END
echo "export SLURM_CONF=$SLURM_CONF" >"$dir/env.sh"

munged --key-file="$dir/munge/munge.key" --socket="$dir/run/munge.socket" \
    --pid-file="$dir/run/munged.pid" --seed-file="$dir/munge/munge.seed" \
    --log-file="$dir/log/munged.log" || fail "munged did not start"
slurmctld -f "$SLURM_CONF" || fail "slurmctld did not start"
slurmd -f "$SLURM_CONF" -N "$host" || fail "slurmd did not start"

for _ in $(seq 300); do
    case $(sinfo -h -o %t 2>/dev/null) in idle | mix | alloc) exit 0 ;; esac
    sleep 0.1
done
fail "the node is not idle after 30 s"
