#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
unset ITERATIONS MORE UNTIL NUM SEED ENGINE CLUSTER_ENV MAKEFLAGS

# A line through twelve runs and three iterations, with settings for the cluster; `started` has the name of
# each run that was started. The fourth run of an iteration fails always, the third once; while there is a
# file `hold` the second does not end.
with_case() {
    mkdir case
    cp "$ROOT"/examples/linear/{params.txt,obs.txt,linear.awk} case/
    cat >case/model <<END
#!/bin/bash
echo "\$1" >>"$PWD/started"
case \$2 in
    1) while [ -e "$PWD/hold" ]; do sleep 0.05; done ;;
    2) ! mkdir "$PWD/failed-\$1" 2>/dev/null || exit 3 ;;
    3) exit 4 ;;
    4) [ ! -e "$PWD/hang" ] || sleep 60 ;;
esac
sleep "\$(cat "$PWD/pause" 2>/dev/null || echo 0)"
exec awk -f "$PWD/case/linear.awk" -v a="\$3" -v b="\$4" -v name="\$1"
END
    chmod +x case/model
    printf '%s\n' NAME=line CONTROL=x OBSERVABLES=y NUM=12 ITERATIONS=3 NOISE=y=0.2 \
        'MODEL={case}/model {description} {key} {a} {b}' >case/case.env
    printf '%s\n' ROWS_PER_TASK=3 TIME=5 RETRIES=1 POLL=0.3 "$@" >case/cluster.env
}

with_pbs() {
    export FAKE_PBS=$PWD/pbs PATH=$ROOT/tests/scripts/fake-pbs:$PATH
    mkdir pbs
}

# Waits until a command succeeds.
with_wait_for() {
    local -i tries=0
    until "$@" >/dev/null 2>&1; do
        sleep 0.2
        tries+=1
        [ $tries -lt 600 ] || { echo "not so: $*"; squeue; cat fit/control.log; return 1; }
    done
}

# No answer is no idle queue.
is_idle() { local jobs; jobs=$(squeue -h) && [ -z "$jobs" ]; }
is_idle_pbs() { ! compgen -G "$FAKE_PBS/*.fake"; }
is_started() { [ -e started ] && [ "$(wc -l <started)" -ge "$1" ]; }
is_finished() { status fit | tail -n 1 | grep -x finished; }

# The tables are, to the byte, those of a calibration on this machine that nothing disturbed.
with_tables_as_undisturbed() {
    local file
    rm -f hold pause
    calibrate case local undisturbed
    same "$(cd fit && echo iter*)" "$(cd undisturbed && echo iter*)"
    for file in $(cd undisturbed && ls ./*.txt iter*/*.txt); do cmp "fit/$file" "undisturbed/$file"; done
}

a_calibration_in_the_queue_ends_with_the_tables_of_one_here() {
    with_slurm
    with_case
    sed -i 's/^NUM=.*/NUM=4/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    # Settings that are given once hold in all jobs and in later calls.
    NUM=12 SEED=3 ends_with 0 submit case fit
    says 'goes on when the runs have ended'
    ends_with 0 submit case fit
    says 'is in the queue already'
    with_wait_for is_idle
    is_finished
    MORE=1 ends_with 0 submit case fit
    with_wait_for is_idle
    ends_with 0 status fit
    same "$(grep -c '^iteration [012]: .* failed; sigma' out)" 3
    same "$(tail -n 1 out)" finished
    # One attempt more for those that failed, none for those that had ended well.
    same "$(sort started | uniq -d | wc -l)" 6
    same "$(sort -u started | wc -l)" 36
    same "$(grep -v $'\tok\t' fit/iter0/status.txt | tail -n +2)" \
        $'line_Iter0_Sample03\tmissing\tno line_Iter0_Sample03_sim.txt; exit code 4'
    NUM=12 SEED=3 UNTIL=3 with_tables_as_undisturbed
}

# Forty runs an iteration, four a task, two tasks at a time; one fails once, one always, one has no end.
whatever_breaks_the_tables_are_those_of_an_undisturbed_calibration() {
    with_slurm
    with_case ROWS_PER_TASK=4 MAX_CONCURRENT=2 RUN_TIMEOUT=2
    touch hang
    echo 0.5 >pause
    sed -i 's/^ITERATIONS=.*/ITERATIONS=2/; s/^NUM=.*/NUM=40/' case/case.env
    # The first to weigh runs hangs until its whole process group is killed.
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
    touch submitted
    # The scheduler is killed in the middle of an array, when it has saved what it was given.
    with_wait_for test slurm/state/job_state -nt submitted
    kill -9 "$(cat slurm/run/slurmctld.pid)"
    ends_with 2 status fit
    says 'the scheduler does not answer'
    slurmctld -f "$SLURM_CONF"
    rm pause
    with_wait_for test -e group
    ends_with 0 status fit
    grep -q '^controlling job [0-9]*: running' out
    kill -9 -- "-$(tr -d ' ' <group)"
    with_wait_for is_idle
    ends_with 1 status fit
    grep -q '^no controlling job is in the queue' out
    ends_with 0 submit case fit
    with_wait_for is_idle
    is_finished
    same "$(grep -v $'\tok\t' fit/iter1/status.txt | sed 's/.*txt; //' | paste -sd ' ')" \
        'sample	status	detail exit code 4 exit code 124 TIMEOUT'
    # What had ended well never ran again.
    same "$(sort started | uniq -d | grep -v 'Sample0[234]')" ''
    RUN_TIMEOUT=2 with_tables_as_undisturbed
}

runs_that_the_scheduler_loses_are_submitted_again() {
    with_slurm
    with_case RETRIES=0
    mkdir failed-line_Iter{0,1,2}_Sample02
    # No task starts.
    scontrol update partitionname=debug state=down
    ends_with 0 submit case fit
    scancel "$(awk '{ print $2 }' fit/iter0/runs/.run/jobs)"
    scontrol update partitionname=debug state=up
    with_wait_for is_idle
    is_finished
    with_tables_as_undisturbed
}

runs_that_are_lost_again_and_again_are_left_out() {
    with_case
    mkdir bin
    # Takes everything and runs nothing.
    printf '#!/bin/sh\necho 1\n' >bin/sbatch
    printf '#!/bin/sh\n' >bin/squeue
    chmod +x bin/*
    PATH=$PWD/bin:$PATH
    printf 'description key a b\nr0 0 1 2\nr1 1 1 2\n' >samples.txt
    CASE=case ends_with 0 run-slurm samples.txt "$PWD/case/model {description} {key} {a} {b}" runs
    says '0 run, 2 failed: r0 (137 LOST) r1 (137 LOST)'
    absent runs/.run
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
    with_wait_for is_idle
    ends_with 1 status fit
    grep -q '^iteration 0: 12 runs: 0 done, 0 running, 0 failed, 12 to come' out
    ends_with 0 submit case fit
    with_wait_for is_idle
    with_tables_as_undisturbed
}

status_tells_how_far_it_is_and_cancel_ends_it() {
    with_slurm
    with_case MAX_CONCURRENT=1
    touch hold
    echo 1 >pause
    ends_with 0 submit case fit
    with_wait_for is_started 2
    ends_with 0 status fit
    grep -qE '^iteration 0: 12 runs: 1 done, 1 running, 0 failed, 10 to come; about [1-9][0-9]* (s|min) left$' out || { cat out; false; }
    grep -q '^controlling job [0-9]*: pending (dependency)' out
    same "$(grep -c '#' out)" 0
    script -qec 'status fit' terminal >/dev/null
    grep -qE '^\[#+\.+\] 1 of 12' terminal
    ends_with 0 cancel fit
    says '2 jobs cancelled'
    with_wait_for is_idle
    ends_with 1 status fit
    grep -q ' 0 running' out
    ends_with 0 cancel fit
    says '0 jobs cancelled'
    rm hold pause
    ends_with 0 submit case fit
    with_wait_for is_idle
    with_tables_as_undisturbed
}

pbs_carries_a_calibration_too() {
    with_pbs
    export ENGINE=pbs
    with_case
    touch hold
    ends_with 0 submit case fit
    says 'job 2.fake goes on when the runs have ended'
    with_wait_for is_started 2
    ends_with 0 submit case fit
    says 'is in the queue already, as job 2.fake'
    ENGINE=slurm ends_with 2 submit case fit
    says 'fit: is in the queue of pbs; cancel it first'
    ends_with 0 status fit
    grep -q '^iteration 0: 12 runs: 1 done, 1 running' out
    same "$(tail -n 1 out)" 'controlling job 2.fake: held'
    ends_with 0 cancel fit
    says '2 jobs cancelled'
    ends_with 1 status fit
    rm hold
    ends_with 0 submit case fit
    with_wait_for is_finished
    grep -q -- '-W depend=afterany:[0-9]*\[\].fake' pbs/calls
    with_tables_as_undisturbed
}

torque_carries_a_calibration_too() {
    with_pbs
    export ENGINE=pbs FAKE_PBS_FLAVOUR=torque
    with_case
    # All tasks of the first iteration are there when the controlling job is submitted; later some end meanwhile.
    echo 1 >pause
    PACKED=1 ends_with 0 submit case fit
    rm pause
    with_wait_for is_finished
    # The controlling jobs, which have nothing of our environment, pack too.
    compgen -G 'fit/iter2/runs/*_packed.txt'
    # Behind a job a task.
    grep -qE -- '-W depend=afterany(:[0-9]+.fake){4} ' pbs/calls
    with_tables_as_undisturbed
}

runs_that_end_while_the_controlling_job_is_submitted_do_not_stop_it() {
    with_pbs
    export ENGINE=pbs FAKE_PBS_FLAVOUR=torque
    with_case
    # Four jobs of a task, one of which ends after the other; and of those that it is to wait for, the first has
    # always ended when the controlling job arrives.
    # shellcheck disable=SC2016  # the model expands it
    sed -i 's|^sleep .*|sleep "$(($2 / 3)).3"|' case/model
    mkdir late
    cat >late/qsub <<END
#!/bin/bash
for word; do
    [[ \$word == depend=afterany:* ]] || continue
    IFS=: read -r _ first _ <<<"\$word"
    while [ -e "$FAKE_PBS/\$first" ]; do sleep 0.02; done
done
exec "$ROOT/tests/scripts/fake-pbs/qsub" "\$@"
END
    chmod +x late/qsub
    PATH=$PWD/late:$PATH ITERATIONS=1 ends_with 0 submit case fit
    [ "$(grep -c 'to depend on' err)" -ge 3 ] || { cat err; return 1; }
    with_wait_for is_finished
    ITERATIONS=1 with_tables_as_undisturbed
}

what_cannot_be_submitted_is_said_at_once() {
    with_case
    ends_with 2 submit nowhere fit
    says 'nowhere/case.env: no such case'
    ENGINE=local ends_with 2 submit case fit
    says 'ENGINE=local has no queue'
    cp -r case 'a case'
    ends_with 2 submit 'a case' fit
    says 'a case: make cannot take a path with blanks'
    ends_with 2 submit case 'a fit'
    says 'a fit: make cannot take a path with blanks'
    absent 'a fit' fit
    ends_with 2 status fit
    says 'no calibration there'
    ends_with 2 cancel fit
    says 'was not submitted'
}

facts "$@"
