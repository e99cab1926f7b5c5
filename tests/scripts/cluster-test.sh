#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH

# Forty rows; the model fails once for 7, always for 9, hangs for 11, and notes every start.
with_model() {
    cat >model <<END
#!/bin/bash
echo "\$2" >>"$PWD/started"
case \$2 in
    7) mkdir "$PWD/failed" 2>/dev/null && exit 3 ;;
    9) exit 4 ;;
    11) sleep 60 ;;
esac
sleep "\${PAUSE:-0}"
printf 'u\tf\n0\t%s\n' "\$2" >"\$1_sim.txt"
END
    chmod +x model
    model="$PWD/model {description} {a}"
    awk 'BEGIN {
        print "description\tkey\ta"
        for (i = 0; i < 40; i++) printf "r%02d\t%d\t%d\n", i, i, i
    }' >samples.txt
    printf '%s\n' rows_per_task=4 max_concurrent=2 run_timeout=2 poll=0.3 time=5 >site.toml
    local setting
    for setting; do
        sed -i "/^${setting%%=*}=/d" site.toml
        echo "$setting" >>site.toml
    done
}

# run ENGINE ARGUMENT...
with_site() { local engine=$1; shift; gl-run "$engine" --cluster site.toml "$@"; }

with_pbs() {
    export FAKE_PBS=$PWD/pbs PATH=$ROOT/tests/scripts/fake-pbs:$PATH
    mkdir pbs
}

forty_runs_in_slurm_and_a_second_call_takes_what_is_missing() {
    with_slurm
    with_model
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '40 rows: 0 complete before, 37 run, 3 failed: r07 (3) r09 (4) r11 (124 TIMEOUT)'
    same "$(sort started | uniq -d)" ''
    same "$(wc -l <started)" 40
    # Ten tasks, and never more than two at a time.
    same "$(wc -l <slurm/log/jobcomp.log)" 10
    rm started
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '40 rows: 37 complete before, 1 run, 2 failed'
    same "$(sort -n started)" $'7\n9\n11'
    ends_with 0 gl-run local samples.txt "$PWD/model {description} 1" local
    same "$(cat runs/r12_sim.txt)" $'u\tf\n0\t12'
}

retries_recover_what_failed_once() {
    with_slurm
    with_model retries=1
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '38 run, 2 failed: r09 (4) r11 (124 TIMEOUT)'
    same "$(sort -n started | uniq -d)" $'7\n9\n11'
}

a_killed_engine_finds_its_array_again() {
    with_slurm
    with_model
    setsid gl-run slurm --cluster site.toml samples.txt "$model" runs &
    local group=$!
    until [ -e started ]; do sleep 0.1; done
    kill -9 -- "-$group"
    ends_with 1 with_site slurm --no-wait samples.txt "$model" runs
    says 'in the queue already'
    ends_with 2 gl-run local samples.txt "$model" runs
    says 'gl-run slurm has runs in the queue'
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '2 failed'
    same "$(grep -vxE '7|9|11' started | sort | uniq -d)" ''
}

no_wait_prints_the_jobs_and_returns() {
    with_slurm
    with_model
    ends_with 1 with_site slurm --no-wait samples.txt "$model" runs
    grep -qE '^gl-[0-9-]+ [0-9]+$' out
}

arrays_are_cut_to_what_the_site_allows() {
    export SLURM_TEST_MAX_ARRAY=3
    with_slurm
    with_model
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '37 run, 3 failed'
    same "$(grep -o ' ArrayJobId=[0-9]*' slurm/log/jobcomp.log | sort -u | wc -l)" 4
}

a_cancelled_run_is_said_so_and_the_other_rows_of_its_task_go_on() {
    with_slurm
    with_model run_timeout=\"\"
    printf 'description a\nr0 0\nr1 11\nr2 2\n' >samples.txt
    with_site slurm samples.txt "$model" runs 2>err &
    until [ -e started ] && grep -qx 11 started; do sleep 0.1; done
    scancel --user root
    wait $!
    says '2 run, 1 failed: r1 (137 CANCELLED)'
    same "$(cat started)" $'0\n11\n2'
}

a_controller_that_is_killed_and_comes_back_loses_nothing() {
    with_slurm
    with_model retries=2
    export PAUSE=0.2
    with_site slurm samples.txt "$model" runs 2>err &
    local engine=$!
    until [ -e started ]; do sleep 0.1; done
    # The controller saves what it knows every few seconds; what it forgets, RETRIES asks for again.
    sleep 3
    kill -9 "$(cat slurm/run/slurmctld.pid)"
    sleep 3
    slurmctld -f "$SLURM_CONF"
    # It drains a node on which it finds a job that it has forgotten; resuming it is the site's business.
    while kill -0 $engine 2>/dev/null; do
        sleep 1
        [[ $(sinfo -h -o %t) != drain* ]] || scontrol update nodename="$(hostname -s)" state=resume
        squeue -h -o '%i %r' | awk '/Held/ { print $1 }' | xargs -r -n 1 scontrol release
    done
    local status=0
    wait $engine || status=$?
    same "$status" 0
    says '38 run, 2 failed'
}

wrong_settings_are_refused_with_their_line() {
    with_model
    while IFS='|' read -r setting message; do
        printf 'time=5\n%s\n' "$setting" >site.toml
        ends_with 2 with_site slurm samples.txt "$model" runs
        says "site.toml:2: $message"
    done <<'END'
partiton="x"|unknown field `partiton`, expected one of `partition`
account="$(touch hit)"|account: "$(touch hit)": use letters
modules="a;b"|modules
rows_per_task=0|rows_per_task: 0: give a whole number from 1
threads="two"|threads
packed="yes"|packed
END
    absent hit runs
}

hostile_tables_are_not_submitted() {
    with_model
    with_pbs
    # shellcheck disable=SC2016
    for row in '$(touch hit) 1' '../a 1' 'a;b 1' 'a 1;2' "a '1'" 'a b 1'; do
        printf 'description a\ngood 1\n%s\n' "$row" >samples.txt
        for engine in slurm pbs; do
            ends_with 2 with_site "$engine" samples.txt "$model" runs
            says 'samples.txt:3'
        done
    done
    absent hit runs pbs/calls
}

forty_runs_in_pbs_and_a_second_call_takes_what_is_missing() {
    with_pbs
    with_model
    ends_with 0 with_site pbs samples.txt "$model" 'the runs'
    says '40 rows: 0 complete before, 37 run, 3 failed: r07 (3) r09 (4) r11 (124 TIMEOUT)'
    same "$(wc -l <started)" 40
    grep -q -- '-l walltime=300 -l select=1:ncpus=1 -J 0-9%2' pbs/calls
    rm started
    ends_with 0 with_site pbs samples.txt "$model" 'the runs'
    same "$(sort -n started)" $'7\n9\n11'
    # What is left is one task, of which PBS makes no array.
    same "$(tail -n 1 pbs/calls | grep -c -- -J)" 0
}

packed_runs_in_slurm_leave_a_file_a_task() {
    with_slurm
    with_model retries=1 packed=true
    ends_with 0 with_site slurm samples.txt "$model" runs
    says '38 run, 2 failed: r09 (4) r11 (124 TIMEOUT)'
    # The first run of each task, and the one that came out well later.
    same "$(cd runs && ls ./*_packed.txt)" "$(printf './r%s_packed.txt\n' 00 04 07 08 12 16 20 24 28 32 36)"
    ends_with 0 gl-run unpack runs/*_packed.txt unpacked
    same "$(cat unpacked/r12_sim.txt)" $'u\tf\n0\t12'
    same "$(find unpacked -type f | wc -l)" 76
    rm runs/*_packed.txt runs/slurm.log
    same "$(ls -A runs)" $'r09.log\nr09.status\nr11.log\nr11.status'
}

packed_runs_in_pbs_leave_a_file_a_task_and_a_second_call_takes_what_is_missing() {
    with_pbs
    with_model packed=true
    ends_with 0 with_site pbs samples.txt "$model" runs
    says '40 rows: 0 complete before, 37 run, 3 failed: r07 (3) r09 (4) r11 (124 TIMEOUT)'
    same "$(find runs -name '*_packed.txt' | wc -l)" 10
    truncate -s -1 runs/r36_packed.txt
    rm started
    ends_with 0 with_site pbs samples.txt "$model" runs
    same "$(sort -n started)" $'7\n9\n11\n39'
}

a_task_that_is_started_again_goes_on_where_it_was() {
    with_pbs
    export FAKE_PBS_STARTS=2
    local packed
    for packed in false true; do
        rm -rf started failed
        with_model run_timeout=1 packed=$packed
        ends_with 0 with_site pbs samples.txt "$model" "runs$packed"
        says '38 run, 2 failed'
        same "$(sort -n started | uniq -d)" $'7\n9\n11'
    done
    # What the second start has run is in a file of its own.
    same "$(find runstrue -name '*_packed.txt' | wc -l)" 11
}

torque_gets_a_job_a_task() {
    with_pbs
    with_model
    FAKE_PBS_FLAVOUR=torque ends_with 0 with_site pbs samples.txt "$model" runs
    says '37 run, 3 failed'
    same "$(wc -l <pbs/calls)" 10
    same "$(grep -c -- -J pbs/calls)" 0
}

facts "$@"
