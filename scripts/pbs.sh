# shellcheck shell=bash
# What run-pbs, submit, status and cancel share: to ask PBS and to submit to it. Sourced after lib.sh.
# slurm.sh has the same functions for SLURM: control_in_queue, arrays_in_queue, submit_control_job,
# cancel_jobs.

# PBS, unlike Torque, says so in its version.
is_pbs() { qsub --version 2>&1 | grep -qi pbs_version; }

# site_options: sets options, what cluster.env asks for in the words of qsub. Only with -S is it our shell
# that reads a job script.
site_options() {
    local time=${site[TIME]}
    options=(-S /bin/bash -j oe)
    # A number alone is one of minutes to SLURM, and of seconds to PBS.
    [[ ! $time =~ ^[0-9]+$ ]] || time=$((10#$time * 60))
    [ -z "${site[PARTITION]}" ] || options+=(-q "${site[PARTITION]}")
    [ -z "${site[ACCOUNT]}" ] || options+=(-A "${site[ACCOUNT]}")
    [ -z "$time" ] || options+=(-l "walltime=$time")
    if is_pbs; then
        options+=(-l "select=1:ncpus=${site[THREADS]}${site[MEM]:+:mem=${site[MEM]}}")
    else
        options+=(-l "nodes=1:ppn=${site[THREADS]}${site[MEM]:+,mem=${site[MEM]}}")
    fi
}

# in_pbs ID...: those of the jobs that are in the queue, each with its state. Jobs that have ended are
# unknown to qstat, or complete; any other failure is no answer, and a failure here.
in_pbs() {
    local id answer
    for id; do
        if answer=$(qstat "$id" 2>&1); then
            awk -v id="$id" '
                BEGIN { split("B begun E exiting H held Q queued R running S suspended T moving W waiting", word) }
                $5 ~ /^[A-BD-Z]$/ && $5 != "F" {
                    for (j = 1; j in word; j += 2) if (word[j] == $5) { print id, word[j + 1]; exit }
                    print id, $5
                    exit
                }' <<<"$answer"
        elif ! grep -qiE 'unknown job|has finished' <<<"$answer"; then
            printf '%s\n' "$answer" >&2
            return 1
        fi
    done
}

# control_in_queue OUT: id and state of the controlling job of a calibration; nothing if there is none but
# the one that asks.
control_in_queue() {
    local id
    id=$(cat "$1/control.id" 2>/dev/null) || return 0
    [ "$id" = "${PBS_JOBID-}" ] || in_pbs "$id"
}

# arrays_in_queue OUT: the same of the jobs that a calibration has noted.
arrays_in_queue() {
    local ids
    mapfile -t ids < <(jobs_noted "$1" | awk 'NF > 1 { print $2 }')
    in_pbs "${ids[@]}"
}

# submit_control_job OUT AFTER...: its controlling job, when the jobs AFTER have ended; prints the id.
submit_control_job() {
    local out=$1 after=() options
    shift
    [ $# -eq 0 ] || after=(-W "depend=afterany$(printf ':%s' "$@")")
    site_options
    qsub -N gl-control "${options[@]}" -o "$(cd "$out" && pwd)/control.log" "${after[@]}" "$out/control.sh" >"$out/control.id.part" ||
        return 1
    mv "$out/control.id.part" "$out/control.id"
    cat "$out/control.id"
}

# cancel_jobs OUT ID...
cancel_jobs() { qdel "${@:2}" || true; }
