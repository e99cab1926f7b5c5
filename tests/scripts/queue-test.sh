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

with_slurm() {
    needs slurm sbatch slurmctld slurmd munged
    [ "$(id -u)" = 0 ] || { echo 'a private SLURM needs root' >reason; exit 77; }
    export SLURM_TEST_DIR=$PWD/slurm SLURM_TEST_CPUS=4
    mkdir slurm
    # munged wants its socket where everybody may look.
    chmod 755 .
    trap '"$ROOT/tests/slurm/stop.sh"' EXIT
    "$ROOT/tests/slurm/start.sh"
    # shellcheck source=/dev/null
    . slurm/env.sh
}

with_idle_queue() {
    local -i tries=0
    while [ -n "$(squeue -h)" ]; do
        sleep 0.3
        tries+=1
        [ $tries -lt 400 ] || { squeue; cat fit/control.log; return 1; }
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
    cat out fit/control.log fit/iter0/status.txt; head -n 6 fit/iter0/samples.txt; cat started; ls -A fit fit/iter0
    same "$(grep -c '^iteration [012]: ' out)" 3
    same "$(tail -n 1 out)" finished
    with_tables_as_undisturbed
    exit 1
}

facts "$@"
