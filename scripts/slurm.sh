# shellcheck shell=bash
# What run-slurm, submit, status and cancel share: to ask SLURM and to submit to it. Sourced after lib.sh.

# site_options: sets options, what cluster.env asks for in the words of sbatch.
site_options() {
    local key
    options=(--cpus-per-task="${site[THREADS]}")
    for key in PARTITION ACCOUNT QOS TIME MEM; do
        [ -z "${site[$key]}" ] || options+=("--${key,,}=${site[$key]}")
    done
}

# queued NAME[,NAME...]: ids, states and reasons of the jobs of these names, an array once; not of the
# job that asks. Fails while the scheduler does not answer.
queued() {
    local answer
    answer=$(squeue --noheader --name="$1" --format='%F %T %r') || return 1
    awk -v own="${SLURM_JOB_ID-}" '$1 != own && $2 != "COMPLETING" && !seen[$1]++' <<<"$answer"
}

# submit_job NAME ARGUMENT...: prints the id of the job that sbatch makes of the arguments.
submit_job() {
    local name=$1 id attempt
    shift
    for attempt in 1 2 3 4 5; do
        id=$(sbatch --parsable --job-name="$name" "$@") && break
        [ "$attempt" -lt 5 ] || return 1
        sleep $((attempt * 2))
        # It may have been taken although the answer was lost.
        id=$(queued "$name" 2>/dev/null | awk 'NR == 1 { print $1 }')
        [ -z "$id" ] || break
    done
    printf '%s\n' "${id%%;*}"
}

# control_name OUT: what the controlling jobs of a calibration are called. The queue is asked for the
# name, never for an id that was noted: a controller that crashes gives its last ids again.
control_name() {
    local sum
    sum=$(cd "$1" && pwd -P | cksum)
    printf 'gl-control-%s\n' "${sum%% *}"
}

# array_names OUT: the arrays that a calibration has noted, with commas; none where no run is submitted.
array_names() { (cat "$1"/iter*/runs/.run/jobs 2>/dev/null || true) | awk '{ printf "%s%s", sep, $1; sep = "," }'; }
