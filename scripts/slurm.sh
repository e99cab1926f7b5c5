# shellcheck shell=bash
# What run-slurm, submit, status and cancel share: to ask SLURM and to submit to it. Sourced after lib.sh.
# pbs.sh has the same functions for PBS: control_in_queue, arrays_in_queue, submit_control_job,
# cancel_jobs.

# site_options: sets options, what cluster.env asks for in the words of sbatch.
site_options() {
    local key
    options=(--cpus-per-task="${site[THREADS]}")
    for key in PARTITION ACCOUNT QOS TIME MEM; do
        [ -z "${site[$key]}" ] || options+=("--${key,,}=${site[$key]}")
    done
}

# Seconds between attempts: a controller may be busy, or away for a moment. A job has time; who looks on
# has not.
PAUSES='1 2 4'
[ -z "${SLURM_JOB_ID-}" ] || PAUSES='1 2 4 8 15 30 60 60 60 60 60'

# queued NAME[,NAME...]: ids, states and reasons of the jobs of these names, an array once. Fails if the
# scheduler does not answer.
queued() {
    local answer pause
    for pause in $PAUSES ''; do
        answer=$(squeue --noheader --name="$1" --format='%F %T %r') && break
        [ -n "$pause" ] || return 1
        sleep "$pause"
    done
    awk '$2 != "COMPLETING" && !seen[$1]++' <<<"$answer"
}

# submit_job NAME ARGUMENT...: prints the id of the job that sbatch makes of the arguments.
submit_job() {
    local name=$1 answer pause
    shift
    for pause in $PAUSES ''; do
        if answer=$(sbatch --parsable --job-name="$name" "$@" 2>&1); then break; fi
        printf '%s\n' "$answer" >&2
        # What is wrong with a job stays wrong.
        [ -n "$pause" ] && grep -qiE 'contact|connect|timed out|temporarily|zero bytes' <<<"$answer" || return 1
        sleep "$pause"
        # It may have been taken although the answer was lost.
        answer=$(queued "$name" | awk 'NR == 1 { print $1 }')
        [ -z "$answer" ] || break
    done
    # Beside the id there may be warnings.
    grep -v '^[0-9][0-9;a-z_-]*$' <<<"$answer" >&2 || true
    grep -o '^[0-9]*' <<<"$answer" | grep -m 1 .
}

# control_name OUT: what the controlling jobs of a calibration are called. The queue is asked for the
# name, never for an id that was noted: a controller that crashes gives its last ids again.
control_name() {
    local sum
    sum=$(cd "$1" && pwd -P | cksum)
    printf 'gl-control-%s\n' "${sum%% *}"
}

# control_in_queue OUT: id, state and reason of the controlling job of a calibration; nothing if there
# is none but the one that asks.
control_in_queue() { queued "$(control_name "$1")" | awk -v own="${SLURM_JOB_ID-}" '$1 != own'; }

# arrays_in_queue OUT: the same of the arrays that a calibration has noted.
arrays_in_queue() {
    local names
    names=$(jobs_noted "$1" | awk '{ printf "%s%s", sep, $1; sep = "," }')
    [ -z "$names" ] || queued "$names"
}

# submit_control_job OUT AFTER...: its controlling job, when the jobs AFTER have ended; prints the id.
submit_control_job() {
    local out=$1 after=() options
    shift
    [ $# -eq 0 ] || after=("--dependency=afterany$(printf ':%s' "$@")")
    site_options
    submit_job "$(control_name "$out")" "${after[@]}" "${options[@]}" --output="$(cd "$out" && pwd)/control.log" \
        --open-mode=truncate "$out/control.sh"
}

# cancel_jobs OUT ID...: also a controlling job that has another id by now, and first, since it submits.
cancel_jobs() {
    scancel --name="$(control_name "$1")" || true
    scancel "${@:2}" || true
}
