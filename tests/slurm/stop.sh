#!/bin/bash
# Stop what start.sh has started, by its pid files; all jobs are cancelled first, unless KEEP_STATE=1.
dir=${SLURM_TEST_DIR:?set SLURM_TEST_DIR as for start.sh}
export SLURM_CONF=$dir/etc/slurm.conf PATH=/usr/sbin:/usr/bin:/sbin:/bin:$PATH

# A zombie counts as dead.
lives() { grep -q '^State:[[:space:]]*[^ZX[:space:]]' "/proc/$1/status" 2>/dev/null; }

if [ -s "$dir/run/slurmctld.pid" ] && lives "$(cat "$dir/run/slurmctld.pid")" && [ "${KEEP_STATE:-0}" != 1 ]; then
    timeout 10 squeue -h -o %A | sort -u | xargs -r timeout 10 scancel
    for _ in $(seq 100); do
        [ -n "$(timeout 5 squeue -h 2>/dev/null)" ] || break
        sleep 0.1
    done
fi

status=0
for daemon in slurmd slurmctld munged; do
    file=$dir/run/$daemon.pid
    if [ -s "$file" ] && lives "$(cat "$file")"; then
        pid=$(cat "$file")
        kill "$pid"
        for _ in $(seq 150); do
            lives "$pid" || break
            sleep 0.1
        done
        if lives "$pid"; then
            echo "stop.sh: $daemon ($pid) did not stop; killed" >&2
            kill -9 "$pid"
            status=1
        fi
    fi
    rm -f "$file"
done
exit $status
