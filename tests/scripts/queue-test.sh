#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH

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
    cat >case/case.toml <<'END'
name = "line"
control = "x"
observables = ["y"]
num = 12
iterations = 3
posterior = "weights"
noise = { y = 0.2 }
model.local = "{case}/model {description} {key} {a} {b}"

[cluster]
END
    printf '%s\n' rows_per_task=3 time=5 poll=0.3 >>case/case.toml
    local setting
    for setting in retries=1 "$@"; do
        sed -i "/^${setting%%=*}=/d" case/case.toml
        echo "$setting" >>case/case.toml
    done
}

# The same in two tests: a run is noted with its test, and what one does wrong it does in one of them.
with_tests() {
    sed -i 's/{a} {b}"/{a} {b} {t}"/' case/case.toml
    printf '\n[[test]]\nname = "%s"\nobs = "obs.txt"\ngiven = { t = %d }\n' one 1 two 2 >>case/case.toml
    # shellcheck disable=SC2016  # of the model
    sed -i 's/echo "\$1"/echo "$1-$5"/; s/^case \$2 in/case $2-$5 in/; s/^    \([12]\))/    \1-1)/; s/^    \([34]\))/    \1-2)/' case/model
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
is_finished() { gl-status fit | tail -n 1 | grep -x finished; }

# The tables are, to the byte, those of a calibration on this machine that nothing disturbed.
with_tables_as_undisturbed() {
    local file
    rm -f hold pause
    gl-calibrate case --engine local --out undisturbed "$@"
    same "$(cd fit && echo iter*)" "$(cd undisturbed && echo iter*)"
    for file in $(cd undisturbed && ls ./*.txt iter*/*.txt); do cmp "fit/$file" "undisturbed/$file"; done
}

a_calibration_in_the_queue_ends_with_the_tables_of_one_here() {
    with_slurm
    with_case
    sed -i 's/^num = .*/num = 4/; s/^iterations = .*/iterations = 2/' case/case.toml
    # Settings that are given once hold in all jobs and in later calls.
    ends_with 0 gl-submit case --out fit NUM=12 seed=3
    says 'goes on when the runs have ended'
    ends_with 0 gl-submit case --out fit
    says 'is in the queue already'
    with_wait_for is_idle
    is_finished
    ends_with 0 gl-submit case --out fit --more 1
    with_wait_for is_idle
    ends_with 0 gl-status fit
    same "$(grep -c '^iteration [012]: .* failed; sigma' out)" 3
    same "$(tail -n 1 out)" finished
    # One attempt more for those that failed, none for those that had ended well.
    same "$(sort started | uniq -d | wc -l)" 6
    same "$(sort -u started | wc -l)" 36
    same "$(grep -v $'\tok\t' fit/iter0/status.txt | tail -n +2)" \
        $'line_Iter0_Sample03\tmissing\tno line_Iter0_Sample03_sim.txt; exit code 4'
    with_tables_as_undisturbed num=12 seed=3 --until 3
}

# Forty runs an iteration, four a task, two tasks at a time; one fails once, one always, one has no end.
# A task that was being started when the scheduler died can drain the node, and holds the array: what gl-status then says
# is to be typed.
is_hanging_or_released() {
    test -e group && return
    scontrol update nodename="$(hostname -s)" state=resume
    squeue -h -t PD -o %F | sort -u | xargs -r -n 1 scontrol release
    return 1
}

whatever_breaks_the_tables_are_those_of_an_undisturbed_calibration() {
    with_slurm
    with_case rows_per_task=4 max_concurrent=2 run_timeout=2
    touch hang
    echo 0.5 >pause
    sed -i 's/^iterations = .*/iterations = 2/; s/^num = .*/num = 40/' case/case.toml
    # The first to weigh runs hangs until its whole process group is killed.
    mkdir slow
    # Drivers look for the other tools beside themselves.
    cp "$ROOT"/target/release/gl-{submit,calibrate,run} slow
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
    ends_with 0 slow/gl-submit case --out fit
    touch submitted
    # The scheduler is killed in the middle of an array, when it has saved what it was given.
    with_wait_for test slurm/state/job_state -nt submitted
    kill -9 "$(cat slurm/run/slurmctld.pid)"
    local before=$SECONDS
    ends_with 2 gl-status fit
    [ $((SECONDS - before)) -le 20 ]
    says 'the above is what the files say: the scheduler does not answer'
    grep -q '^iteration 0: 40 runs: ' out
    slurmctld -f "$SLURM_CONF"
    rm pause
    with_wait_for is_hanging_or_released
    ends_with 0 gl-status fit
    grep -q '^controlling job [0-9]*: running' out
    kill -9 -- "-$(tr -d ' ' <group)"
    with_wait_for is_idle
    ends_with 1 gl-status fit
    grep -q '^no controlling job is in the queue' out
    ends_with 0 gl-submit case --out fit
    with_wait_for is_idle
    is_finished
    same "$(grep -v $'\tok\t' fit/iter1/status.txt | sed 's/.*txt; //' | paste -sd ' ')" \
        'sample	status	detail exit code 4 exit code 124 TIMEOUT'
    # What had ended well never ran again.
    same "$(sort started | uniq -d | grep -v 'Sample0[234]')" ''
    RUN_TIMEOUT=2 with_tables_as_undisturbed
}

several_tests_are_in_the_queue_at_once_and_go_on_after_a_kill() {
    with_slurm
    with_case
    with_tests
    touch hold
    ends_with 0 gl-submit case --out fit
    # One test has ended while a run of the other has no end.
    with_wait_for is_done_in_the_second_test
    ends_with 0 gl-status fit
    grep -q '^iteration 0: 24 runs: .* 1 running, 1 failed, 1 to come' out || { cat out; false; }
    ends_with 0 gl-cancel fit
    says '2 jobs cancelled'
    with_wait_for is_idle
    ends_with 1 gl-status fit
    rm hold
    ends_with 0 gl-submit case --out fit
    with_wait_for is_idle
    is_finished
    # The fourth run fails in one test alone; the third failed once, in the other.
    same "$(grep -v $'\tok\t' fit/iter1/one/status.txt)" $'sample\tstatus\tdetail'
    same "$(grep -v $'\tok\t' fit/iter1/two/status.txt | tail -n +2)" \
        $'line_Iter1_Sample03\tmissing\tno line_Iter1_Sample03_sim.txt; exit code 4'
    same "$(sort started | uniq -d | grep -v 'Sample03-2')" \
        "$(printf 'line_Iter%s-1\n' 0_Sample01 0_Sample02 1_Sample02 2_Sample02)"
    with_tables_as_undisturbed
}
is_done_in_the_second_test() { gl-status fit >now && grep -q '^    two: 12 runs: 11 done, 0 running, 1 failed, 0 to come$' now; }

runs_that_the_scheduler_loses_are_submitted_again() {
    with_slurm
    with_case retries=0
    mkdir failed-line_Iter{0,1,2}_Sample02
    # No task starts.
    scontrol update partitionname=debug state=down
    ends_with 0 gl-submit case --out fit
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
    CASE=case ends_with 0 gl-run slurm samples.txt "$PWD/case/model {description} {key} {a} {b}" runs
    says '0 run, 2 failed: r0 (137 LOST) r1 (137 LOST)'
    absent runs/.run
}

a_scheduler_that_forgets_its_last_jobs_is_repaired_by_submitting_again() {
    with_slurm
    with_case retries=0
    mkdir failed-line_Iter{0,1,2}_Sample02
    # What it knew before anything was submitted.
    KEEP_STATE=1 "$ROOT/tests/slurm/stop.sh"
    cp -r slurm/state state
    KEEP_STATE=1 "$ROOT/tests/slurm/start.sh"
    # No task starts, so that the node too knows of none.
    scontrol update partitionname=debug state=down
    ends_with 0 gl-submit case --out fit
    kill -9 "$(cat slurm/run/slurmctld.pid)"
    rm -rf slurm/state
    mv state slurm/state
    slurmctld -f "$SLURM_CONF"
    with_wait_for is_idle
    ends_with 1 gl-status fit
    grep -q '^iteration 0: 12 runs: 0 done, 0 running, 0 failed, 12 to come' out
    ends_with 0 gl-submit case --out fit
    with_wait_for is_idle
    with_tables_as_undisturbed
}

status_tells_how_far_it_is_and_cancel_ends_it() {
    with_slurm
    with_case max_concurrent=1
    touch hold
    echo 1 >pause
    ends_with 0 gl-submit case --out fit
    with_wait_for is_started 2
    ends_with 0 gl-status fit
    grep -qE '^iteration 0: 12 runs: 1 done, 1 running, 0 failed, 10 to come; about [1-9][0-9]* (s|min) left$' out || { cat out; false; }
    grep -q '^controlling job [0-9]*: pending (dependency)' out
    same "$(grep -c '#' out)" 0
    script -qec 'gl-status fit' terminal >/dev/null
    grep -qE '^\[#+\.+\] 1 of 12' terminal
    ends_with 0 gl-cancel fit
    says '2 jobs cancelled'
    with_wait_for is_idle
    ends_with 1 gl-status fit
    grep -q ' 0 running' out
    ends_with 0 gl-cancel fit
    says '0 jobs cancelled'
    rm hold pause
    ends_with 0 gl-submit case --out fit
    with_wait_for is_idle
    with_tables_as_undisturbed
}

pbs_carries_a_calibration_too() {
    with_pbs
    with_case
    touch hold
    ends_with 0 gl-submit case --engine pbs --out fit
    says 'job 2.fake goes on when the runs have ended'
    with_wait_for is_started 2
    ends_with 0 gl-submit case --engine pbs --out fit
    says 'is in the queue already, as job 2.fake'
    ends_with 2 gl-submit case --engine slurm --out fit
    says 'fit: is in the queue of pbs; gl-cancel it first'
    ends_with 0 gl-status fit
    grep -q '^iteration 0: 12 runs: 1 done, 1 running' out
    same "$(tail -n 1 out)" 'controlling job 2.fake: held'
    ends_with 0 gl-cancel fit
    says '2 jobs cancelled'
    ends_with 1 gl-status fit
    rm hold
    ends_with 0 gl-submit case --out fit
    with_wait_for is_finished
    grep -q -- '-W depend=afterany:[0-9]*\[\].fake' pbs/calls
    with_tables_as_undisturbed
}

where_the_site_limits_tasks_one_test_comes_after_the_other() {
    with_pbs
    with_case max_concurrent=2
    with_tests
    touch hold
    ends_with 0 gl-submit case --engine pbs --out fit --iterations 1
    with_wait_for is_started 2
    [ -d fit/iter0/one/runs ]
    absent fit/iter0/two/runs
    rm hold
    with_wait_for is_finished
    with_tables_as_undisturbed --iterations 1
    # Who waits for the runs has them in the queue at once.
    sed -i '/^max_concurrent/d' case/case.toml
    rm -r failed-line_Iter0_Sample02
    ends_with 0 gl-calibrate case --engine pbs --out waited --iterations 1
    cmp waited/posterior.txt undisturbed/posterior.txt
    same "$(grep -c '^gl-run pbs' waited/commands.log)" 2
}

torque_carries_a_calibration_too() {
    with_pbs
    export FAKE_PBS_FLAVOUR=torque
    with_case
    # All tasks of the first iteration are there when the controlling job is submitted; later some end meanwhile.
    echo 1 >pause
    ends_with 0 gl-submit case --engine pbs --out fit packed=true
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
    export FAKE_PBS_FLAVOUR=torque
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
    PATH=$PWD/late:$PATH ends_with 0 gl-submit case --engine pbs --out fit --iterations 1
    [ "$(grep -c 'to depend on' err)" -ge 3 ] || { cat err; return 1; }
    with_wait_for is_finished
    with_tables_as_undisturbed --iterations 1
}

what_cannot_be_submitted_is_said_at_once() {
    with_case
    ends_with 2 gl-submit nowhere --out fit
    says 'nowhere/case.toml: no such case'
    ends_with 2 gl-submit case --engine local --out fit
    says '--engine local: has no queue; slurm and pbs have'
    ends_with 2 gl-submit case --out fit nun=3
    says 'nun=3'
    ends_with 2 gl-submit case --out fit --diagnose --more 1
    absent fit
    ends_with 2 gl-status fit
    says 'no calibration there'
    ends_with 2 gl-cancel fit
    says 'was not submitted'
}

paths_with_blanks_are_paths() {
    with_pbs
    with_case
    mv case 'a case'
    sed -i "s|$PWD/case|$PWD/a case|" 'a case/model'
    ends_with 0 gl-submit 'a case' --engine pbs --out 'a fit' --iterations 1
    with_wait_for is_idle_pbs
    ends_with 0 gl-status 'a fit'
    same "$(tail -n 1 out)" finished
}

the_second_driver_is_told_who_has_it() {
    with_pbs
    with_case
    mkdir fit
    exec 9<>fit/.lock
    flock 9
    echo 'gl-calibrate (process 4711 on node3, since 2026-11-22 00:20:32 UTC)' >&9
    ends_with 2 gl-submit case --engine pbs --out fit
    says 'fit: gl-calibrate (process 4711 on node3, since 2026-11-22 00:20:32 UTC) works here'
    exec 9>&-
    ends_with 0 gl-submit case --engine pbs --out fit --iterations 1
    with_wait_for is_idle_pbs
    is_finished
}

what_holds_jobs_is_said_with_what_to_type() {
    with_slurm
    with_case
    touch hold
    # No task starts.
    scontrol update nodename="$(hostname -s)" state=drain reason='Duplicate jobid'
    ends_with 0 gl-submit case --out fit
    with_wait_for is_waiting_for_the_node
    ends_with 0 gl-status fit
    grep -q "; node $(hostname -s) is drained (Duplicate jobid); its administrators resume it: scontrol update nodename=$(hostname -s) state=resume$" out || { cat out; false; }
    scontrol hold "$(awk '{ print $2 }' fit/iter0/runs/.run/jobs)"
    ends_with 0 gl-status fit
    grep -qE "^job [0-9]+ is held .*scontrol release [0-9]+$" out || { cat out; false; }
    same "$(grep -c 'left' out)" 0
    # What it says is typed.
    eval "$(sed -n 's/^job.*: \(scontrol release [0-9]*\)$/\1/p' out)"
    scontrol update nodename="$(hostname -s)" state=resume
    rm hold
    with_wait_for is_idle
    is_finished
}
is_waiting_for_the_node() { gl-status fit >now && grep -q 'is drained' now; }

a_diagnosis_of_two_tests_lives_in_the_queue() {
    with_pbs
    cp -r "$ROOT/examples/contact-effects" case
    # The embedded simulator as a command a row.
    cat >case/one <<'END'
#!/bin/bash
set -e
printf '%s\n' "${1//:/$'\t'}" "${2//:/$'\t'}" >one.txt
gl-contact --programme cycles -s one.txt .
# The parameters that it writes do not know the test.
rm ./*_param.txt
END
    chmod +x case/one
    sed -i '/^\[model\]/,$d' case/case.toml
    local names
    names=$(printf '%s\n' description key && awk -F '[ \t]+' 'NR > 1 && NF && !/^#/ { print $1 }' case/params.txt)
    # shellcheck disable=SC2001  # a name a line
    cat >>case/case.toml <<END
[[test]]
name = "first"
obs = "obs.txt"
given = { number = 1 }

[[test]]
name = "again"
obs = "obs.txt"
given = { number = 2 }

[model]
local = "{case}/one $(paste -sd : <<<"$names") $(sed 's/.*/{&}/' <<<"$names" | paste -sd :)"

[cluster]
rows_per_task = 20
END
    # By the weights of the runs: through an emulator it takes ten times as long.
    ends_with 0 gl-submit case --engine pbs --diagnose --out fit num=20 iterations=2 design_num=60 posterior=weights
    says 'goes on when the runs have ended'
    # Two posteriors, a design and its attribution.
    with_wait_for is_finished || with_wait_for is_finished
    local file
    for file in base/posterior.txt design/round0/attribution.txt attribution.txt shrink.txt; do [ -s "fit/$file" ]; done
    gl-status fit >out
    grep -q '^base: iteration 0: ' out
    grep -q '^design: round 0: [0-9]* runs$' out
    same "$(cut -f 1 fit/locate.txt | sort -u | paste -sd ' ')" 'again.f again.t first.f first.t observable'
}

facts "$@"
