#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
unset ITERATIONS MORE ENGINE CLUSTER_ENV MAKEFLAGS

# A line through twelve runs and three iterations, with settings for the cluster; `started` has the name of
# each run that was started. The fourth run of an iteration fails always, the third once.
with_case() {
    mkdir case
    cp "$ROOT"/examples/linear/{params.txt,obs.txt,linear.awk} case/
    cat >case/model <<END
#!/bin/bash
echo "\$1" >>"$PWD/started"
[[ \$2 != 3 ]] || exit 4
[[ \$2 != 2 ]] || ! mkdir "$PWD/failed-\$1" 2>/dev/null || exit 3
sleep "\$(cat "$PWD/pause" 2>/dev/null || echo 0)"
exec awk -f "$PWD/case/linear.awk" -v a="\$3" -v b="\$4" -v name="\$1"
END
    chmod +x case/model
    printf '%s\n' NAME=line CONTROL=x OBSERVABLES=y NUM=12 ITERATIONS=3 NOISE=y=0.2 \
        'MODEL={case}/model {description} {key} {a} {b}' >case/case.env
    printf '%s\n' ROWS_PER_TASK=3 TIME=5 RETRIES=1 "$@" >case/cluster.env
}

with_idle_queue() {
    local -i tries=0
    while [ -n "$(squeue -h)" ]; do
        sleep 0.3
        tries+=1
        [ $tries -lt 400 ] || { squeue; cat fit/control.log; return 1; }
    done
}

with_file() {
    local -i tries=0
    until [ -e "$1" ]; do
        sleep 0.1
        tries+=1
        [ $tries -lt 600 ] || { squeue; cat fit/control.log; return 1; }
    done
}

# The tables are, to the byte, those of a calibration on this machine that nothing disturbed.
with_tables_as_undisturbed() {
    local file
    calibrate case local undisturbed
    same "$(cd fit && echo iter*)" "$(cd undisturbed && echo iter*)"
    for file in $(cd undisturbed && ls ./*.txt iter*/*.txt); do cmp "fit/$file" "undisturbed/$file"; done
}

a_calibration_in_the_queue_ends_with_the_tables_of_one_here() {
    with_slurm
    with_case
    ends_with 0 submit case fit
    says 'goes on when the runs have ended'
    ends_with 0 submit case fit
    says 'is in the queue already'
    with_idle_queue
    ends_with 0 status fit
    same "$(grep -c '^iteration [012]: .* failed; sigma' out)" 3
    same "$(tail -n 1 out)" finished
    # One attempt more for those that failed, none for those that had ended well.
    same "$(sort started | uniq -d | wc -l)" 6
    same "$(sort -u started | wc -l)" 36
    same "$(grep -v $'\tok\t' fit/iter0/status.txt | tail -n +2)" \
        $'line_Iter0_Sample03\tmissing\tno line_Iter0_Sample03_sim.txt; exit code 4'
    with_tables_as_undisturbed
}

a_killed_controlling_job_is_repaired_by_submitting_again() {
    with_slurm
    with_case
    # The first time it hangs, until its whole process group is killed.
    mkdir slow
    cat >slow/gl-likelihood <<END
#!/bin/bash
if mkdir "$PWD/hung" 2>/dev/null; then
    ps -o pgid= \$\$ >"$PWD/group.part"
    mv "$PWD/group.part" "$PWD/group"
    sleep 60
fi
exec "$ROOT/target/release/gl-likelihood" "\$@"
END
    chmod +x slow/gl-likelihood
    PATH=$PWD/slow:$PATH ends_with 0 submit case fit
    with_file group
    ends_with 0 status fit
    grep -q '^controlling job [0-9]*: running' out
    kill -9 -- "-$(tr -d ' ' <group)"
    with_idle_queue
    ends_with 1 status fit
    grep -q '^no controlling job is in the queue' out
    ends_with 0 submit case fit
    with_idle_queue
    ends_with 0 status fit
    same "$(tail -n 1 out)" finished
    with_tables_as_undisturbed
}

a_scheduler_that_forgets_its_last_jobs_is_repaired_by_submitting_again() {
    with_slurm
    with_case RETRIES=0
    mkdir failed-line_Iter{0,1,2}_Sample02
    # What it knew before anything was submitted.
    KEEP_STATE=1 "$ROOT/tests/slurm/stop.sh"
    cp -r slurm/state state
    KEEP_STATE=1 "$ROOT/tests/slurm/start.sh"
    # No task starts, so that the node too knows of none.
    scontrol update partitionname=debug state=down
    ends_with 0 submit case fit
    kill -9 "$(cat slurm/run/slurmctld.pid)"
    rm -rf slurm/state
    mv state slurm/state
    slurmctld -f "$SLURM_CONF"
    with_idle_queue
    ends_with 1 status fit
    grep -q '^iteration 0: 12 runs: 0 done, 0 running, 0 failed, 12 to come' out
    ends_with 0 submit case fit
    with_idle_queue
    with_tables_as_undisturbed
}

status_tells_how_far_it_is_and_cancel_ends_it() {
    with_slurm
    with_case MAX_CONCURRENT=1
    echo 4 >pause
    ends_with 0 submit case fit
    with_file fit/iter0/runs/line_Iter0_Sample00.status
    sleep 0.5
    ends_with 0 status fit
    grep -qE '^iteration 0: 12 runs: 1 done, 1 running, 0 failed, 10 to come; about [1-9][0-9]* s left$' out || { cat out; false; }
    grep -q '^controlling job [0-9]*: pending (dependency)' out
    same "$(grep -c '#' out)" 0
    script -qec 'status fit' terminal >/dev/null
    grep -qE '^\[#+\.+\] 1 of 12' terminal
    ends_with 0 cancel fit
    says '2 jobs cancelled'
    with_idle_queue
    ends_with 1 status fit
    grep -q ' 0 running' out
    ends_with 0 cancel fit
    says '0 jobs cancelled'
    echo 0 >pause
    ends_with 0 submit case fit
    with_idle_queue
    with_tables_as_undisturbed
}

what_cannot_be_submitted_is_said_at_once() {
    with_case
    ends_with 2 submit nowhere fit
    says 'nowhere/case.env: no such case'
    ENGINE=pbs ends_with 2 submit case fit
    says 'only slurm'
    ends_with 2 status fit
    says 'no calibration there'
    ends_with 2 cancel fit
    says 'was not submitted'
}

facts "$@"
