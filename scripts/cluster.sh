# shellcheck shell=bash
# What run-slurm and run-pbs share: the site's settings, the cut of the missing rows into tasks, and
# waiting until the scheduler knows of none of them. Sourced after lib.sh.
#
# DIR/.run holds what the tasks read, and lives as long as they do:
#     samples.txt  the checked table          rows    line numbers of the rows to run, one a line
#     task.env     how to run a row           jobs    a submitted array a line
#     started      since when runs end        failures a row each time it failed
#     NAME.running the task that a run is in; left behind by one that was killed
#     idle         how many of the last rounds came to no row at all

# cluster_settings: sets site[KEY] from cluster.env beside the case.
cluster_settings() {
    local file=${CLUSTER_ENV:-$CASE/cluster.env} line number=0 key value
    declare -gA site=(
        [PARTITION]='' [ACCOUNT]='' [QOS]='' [TIME]='' [MEM]='' [THREADS]=1 [MODULES]='' [SCRATCH]=''
        [ROWS_PER_TASK]=1 [MAX_CONCURRENT]='' [RUN_TIMEOUT]="${RUN_TIMEOUT:-}" [RETRIES]=0 [POLL]=''
        [PACKED]="${PACKED:-}"
    )
    [ -e "$file" ] || return 0
    while IFS= read -r line || [ -n "$line" ]; do
        number=$((number + 1))
        line=${line%$'\r'}
        [[ $line != '' && $line != '#'* ]] || continue
        key=${line%%=*} value=${line#*=}
        if [[ $line != *=* || ! -v site[$key] ]]; then
            die "$file:$number: $line: no setting; known are ${!site[*]}"
        fi
        [[ $value =~ ^[A-Za-z0-9_.,:/+@%=\ -]*$ ]] ||
            die "$file:$number: $key: \"$value\": use letters, digits, blanks and _ . , : / + @ % = -"
        case $key in
            THREADS | ROWS_PER_TASK | MAX_CONCURRENT)
                [[ $value =~ ^[1-9][0-9]*$ ]] || die "$file:$number: $key: \"$value\" is no number above 0" ;;
            PACKED) [[ $value =~ ^[01]?$ ]] || die "$file:$number: PACKED: \"$value\"; give 1 for packed runs, or 0" ;;
            RETRIES)
                [[ $value =~ ^[0-9]+$ ]] || die "$file:$number: $key: \"$value\" is no whole number" ;;
            POLL)
                [[ $value =~ ^[0-9]+(\.[0-9]+)?$ ]] || die "$file:$number: $key: \"$value\" is no number" ;;
        esac
        site[$key]=$value
    done <"$file"
}

# names_of: after each line number on standard input, the name of its run.
names_of() {
    awk -F '\t' '
        NR == FNR { if (NR == 1) { for (j = 1; j <= NF; j++) if ($j == "description") d = j } else name[NR] = $d; next }
        { print $1, name[$1] }
    ' "$GL_TABLE" -
}

# prepare_tasks ROW...: writes what the tasks read; sets tasks, their number.
prepare_tasks() {
    printf '%s\n' "$@" >"$GL_DIR/.run/rows"
    # From here on a row with a status is one that was tried.
    names_of <"$GL_DIR/.run/rows" | (cd "$GL_DIR" && awk '{ printf "./%s.status%c", $2, 0 }' | xargs -0 rm -f)
    # shellcheck disable=SC2034  # submit_tasks reads it
    tasks=$((($# + site[ROWS_PER_TASK] - 1) / site[ROWS_PER_TASK]))
    printf '%s\n' "$ME" >"$GL_DIR/.run/engine"
    packing "${site[PACKED]}"
    {
        printf 'export %s=%q\n' GL_DIR "$GL_DIR" GL_TABLE "$GL_TABLE" GL_MODEL "$GL_MODEL" CASE "$CASE" \
            PYTHONPATH "$PYTHONPATH" GL_THREADS "${site[THREADS]}" GL_PACKED "$GL_PACKED" RUN_TIMEOUT "${site[RUN_TIMEOUT]}"
        printf '%s=%q\n' MODULES "${site[MODULES]}" SCRATCH "${site[SCRATCH]}" \
            ROWS_PER_TASK "${site[ROWS_PER_TASK]}"
    } >"$GL_DIR/.run/task.env"
}

# job_script FIRST: a script for an array whose index 0 is task FIRST; prints its path.
job_script() {
    local file=$GL_DIR/.run/task-$1.sh
    printf '#!/bin/bash\nexec %q %q %q\n' "$HERE/run-task" "$GL_DIR/.run" "$1" >"$file"
    printf '%s\n' "$file"
}

# forget_last: the array that was refused; those before it are in the queue.
forget_last() {
    sed -i '$d' "$GL_DIR/.run/jobs"
    [ -s "$GL_DIR/.run/jobs" ] || rm "$GL_DIR/.run/jobs"
}

# until_gone: waits until `in_queue` (the engine's own) says that nothing of ours is left. It prints
# what is in the queue, and fails while the scheduler does not answer, which is no reason to go on.
until_gone() {
    local pause=2 left told=''
    while :; do
        if left=$(in_queue) && [ -z "$left" ]; then return; fi
        if [ -z "$told" ] && grep -m 1 Held <<<"$left" >&2; then
            say "held by the scheduler or the site; waiting until it is released or cancelled"
            told=yes
        fi
        sleep "${site[POLL]:-$pause}"
        # Schedulers are shared: ask at ever longer intervals, up to half a minute.
        pause=$((pause < 20 ? pause * 3 / 2 : 30))
    done
}

# settle: runs that were killed with their task get a status with the scheduler's reason, which
# `task_state TASK` (the engine's own) prints.
settle() {
    local marker name reason
    for marker in "$GL_DIR/.run/"*.running; do
        [ -e "$marker" ] || continue
        name=${marker##*/}
        name=${name%.running}
        reason=$(task_state "$(cat "$marker")") || reason=''
        printf '137 %s\n' "${reason:-KILLED}" >"$GL_DIR/$name.status"
        rm -f -- "$marker"
    done
    rm -f "$GL_DIR/.run/jobs"
}

# Rounds in a row that may come to no row at all.
IDLE_ROUNDS=3

# next_round: sets to_do, the rows to submit again: those that failed, up to RETRIES times each; and
# those that no task came to, since its time was over before, or the scheduler has lost it. A row that
# it loses whatever we do is one that failed, too.
next_round() {
    local line name lost=() failed=() idle
    while read -r line name; do
        if [ -e "$GL_DIR/$name.status" ]; then failed+=("$line"); else lost+=("$line $name"); fi
    done < <(missing_rows all | names_of)
    idle=$(cat "$GL_DIR/.run/idle")
    if [ "${#lost[@]}" -lt "$(wc -l <"$GL_DIR/.run/rows")" ]; then idle=0; else idle=$((idle + 1)); fi
    printf '%s\n' "$idle" >"$GL_DIR/.run/idle"
    if [ "$idle" -ge "$IDLE_ROUNDS" ]; then
        for name in "${lost[@]#* }"; do printf '137 LOST\n' >"$GL_DIR/$name.status"; done
        lost=()
    fi
    [ "${#failed[@]}" -eq 0 ] || printf '%s\n' "${failed[@]}" >>"$GL_DIR/.run/failures"
    mapfile -t to_do < <({
        [ "${#failed[@]}" -eq 0 ] || printf '%s\n' "${failed[@]}" |
            awk -v retries="${site[RETRIES]}" 'NR == FNR { times[$1]++; next } times[$1] <= retries' "$GL_DIR/.run/failures" -
        [ "${#lost[@]}" -eq 0 ] || printf '%s\n' "${lost[@]% *}"
    } | sort -n)
}

# run_cluster SAMPLES MODEL DIR: the whole engine, but for what differs between schedulers:
# submit_tasks, which submits `tasks` tasks and adds to DIR/.run/jobs; in_queue; task_state.
run_cluster() {
    local wait=yes goes_on='' left to_do=()
    if [ "${1-}" = --no-wait ]; then wait=''; shift; fi
    arguments "$@"
    cluster_settings
    lock_dir
    if [ -e "$GL_DIR/.run/jobs" ]; then
        [ "$(cat "$GL_DIR/.run/engine")" = "$ME" ] || open_dir
        if [ -z "$wait" ]; then
            until left=$(in_queue); do sleep "${site[POLL]:-10}"; done
            if [ -n "$left" ]; then
                say "$GL_DIR: runs are in the queue already"
                printf '%s\n' "$left"
                return 3
            fi
        else
            say "$GL_DIR: waiting for the runs that are in the queue already"
            until_gone
        fi
        settle
        [ -n "$wait" ] || [ ! -e "$GL_DIR/.run/idle" ] || [ "$(cat "$GL_TABLE")" != "$TABLE" ] || goes_on=yes
    fi
    [ -n "$goes_on" ] || open_dir
    mapfile -t rows < <(missing_rows all)
    if [ -n "$goes_on" ]; then
        next_round
    else
        printf '0\n' >"$GL_DIR/.run/idle"
        to_do=("${rows[@]}")
    fi
    while [ "${#to_do[@]}" -gt 0 ]; do
        prepare_tasks "${to_do[@]}"
        submit_tasks
        if [ -z "$wait" ]; then cat "$GL_DIR/.run/jobs"; return 3; fi
        until_gone
        settle
        next_round
    done
    report "${rows[@]}"
}
