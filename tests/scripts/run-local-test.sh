#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"

# A model that notes that it was started, in `started` beside the table, and then does as its value says.
with_model() {
    cat >model <<'END'
#!/bin/bash
echo "$1" >>"$3/started"
case $2 in
    3*) printf 'u\tf\n0\t' >"$1_sim.txt"; exit 3 ;;
    4*) printf 'u\tf\n0\t' >"$1_sim.txt"; sleep 60 ;;
    5*) exit 0 ;;
esac
sleep "${PAUSE:-0}"
printf 'u\tf\n0\t%s\n' "$2" >"$1_sim.txt"
END
    chmod +x model
    model="$PWD/model {description} {a} $PWD"
}

with_table() {
    printf 'description\tkey\ta\n' >samples.txt
    local value i=0
    for value; do
        printf 'r%d\t%d\t%s\n' "$i" "$i" "$value" >>samples.txt
        i=$((i + 1))
    done
}

a_run_leaves_its_two_files_its_log_and_its_code() {
    with_model
    with_table 1.5
    ends_with 0 run-local samples.txt "$model" runs
    same "$(cat runs/r0_sim.txt)" $'u\tf\n0\t1.5'
    same "$(cat runs/r0_param.txt)" $'a\n1.5'
    same "$(cat runs/r0.status)" 0
    same "$(ls -A runs)" $'r0.log\nr0.status\nr0_param.txt\nr0_sim.txt'
}

hostile_descriptions_are_refused_before_anything_runs() {
    with_model
    # shellcheck disable=SC2016  # the point is that nobody expands it
    for name in 'a/b' '../a' 'a..b' '.a' '-a' 'a b' "a'b" 'a"b' '$(touch${IFS}hit)' '`touch hit`' 'a;b' 'a|b' \
        'a&b' 'a>b' 'a*' 'a\b' 'a{b}' 'é' $'a\nb' '=' ''; do
        printf 'description\tkey\ta\ngood\t0\t1\n%s\t1\t2\n' "$name" >samples.txt
        ends_with 2 run-local samples.txt "$model" runs || { echo "for $name"; return 1; }
        says 'samples.txt:3'
        absent started runs hit
    done
}

cells_that_are_no_numbers_are_refused_before_anything_runs() {
    with_model
    # shellcheck disable=SC2016
    for cell in '' x nan inf '1;2' '$(touch hit)' '`id`' '1 2' '0x10' '__import__("os")' '1e' '--1' '{b}' '='; do
        printf 'description\tkey\ta\ngood\t0\t1\nbad\t1\t%s\n' "$cell" >samples.txt
        ends_with 2 run-local samples.txt "$model" runs || { echo "for $cell"; return 1; }
        says 'samples.txt:3'
        absent started runs hit
    done
}

headers_that_are_wrong_are_refused() {
    with_model
    while IFS='|' read -r header message; do
        printf '%b\n' "$header\n" >samples.txt
        ends_with 2 run-local samples.txt "$model" runs
        says "$message"
        absent runs
    done <<'END'
|no header
a|no column description
description a a|duplicate column a
description !EXEC|cannot be a column name
description a;b|cannot be a column name
description dir|column dir
END
}

a_name_given_twice_is_refused() {
    with_model
    printf 'description a\nr 1\nr 2\n' >samples.txt
    ends_with 2 run-local samples.txt "$model" runs
    says 'samples.txt:3: column description: r is on line 2 already'
}

tables_are_read_whatever_separates_their_fields() {
    with_model
    for table in 'description\ta\nr0\t1.5\n' 'description,a\nr0,1.5\n' '  description   a\n\n r0  1.5 \n' \
        '\xef\xbb\xbf# description a\r\n# note\r\nr0 1.5\r\n' '#description\ta\nr0\t1.5'; do
        rm -rf runs
        printf '%b' "$table" >samples.txt
        ends_with 0 run-local samples.txt "$model" runs
        same "$(cat runs/r0_sim.txt)" $'u\tf\n0\t1.5'
    done
}

a_table_without_rows_is_done_at_once() {
    with_model
    with_table
    ends_with 0 run-local samples.txt "$model" runs
    absent started
}

a_model_that_cannot_run_is_refused() {
    with_table 1
    while IFS='|' read -r model message; do
        ends_with 2 run-local samples.txt "$model" runs
        says "$message"
        absent runs
    done <<'END'
 |MODEL is empty
true {b}|{b} is no column
no-such-program {a}|no program no-such-program
true 'a|a quote is not closed
absent.py|no such script
END
    ends_with 2 run-local absent.txt true runs
    says 'no such samples table'
    ends_with 2 run-local samples.txt
}

words_of_the_command_reach_it_unchanged() {
    with_table 1
    mkdir 'a {a} b'
    # shellcheck disable=SC2016
    printf '#!/bin/bash\nprintf "%%s|" "$@" >"$1_sim.txt"; echo >>"$1_sim.txt"; echo 1 >>"$1_sim.txt"\n' >'a {a} b/model'
    chmod +x 'a {a} b/model'
    # shellcheck disable=SC2016
    CASE='a {a} b' ends_with 0 run-local samples.txt '"{case}/model" {description} "x  y" $HOME * ;{a} "`id`"' 'a {a} b/runs'
    # shellcheck disable=SC2016
    same "$(head -n 1 'a {a} b/runs/r0_sim.txt')" 'r0|x  y|$HOME|*|;1|`id`|'
}

complete_runs_are_not_run_again() {
    with_model
    with_table 1 2 3
    ends_with 0 run-local samples.txt "$model" runs
    ends_with 0 run-local samples.txt "$model" runs
    same "$(sort started | uniq -c | tr -s ' ')" $' 1 r0\n 1 r1\n 2 r2'
    says '2 complete before, 0 run, 1 failed: r2 (3)'
}

incomplete_runs_are_run_again() {
    with_model
    with_table 1 2 6 7 8
    ends_with 0 run-local samples.txt "$model" runs
    printf 'u\tf\n0\t1' >runs/r0_sim.txt
    printf 'u\tf\n' >runs/r1_sim.txt
    rm runs/r2_param.txt
    printf 'a\n7.01\n' >runs/r3_param.txt
    rm started
    ends_with 0 run-local samples.txt "$model" runs
    same "$(sort started)" $'r0\nr1\nr2\nr3'
    same "$(cat runs/r3_param.txt)" $'a\n7'
}

rounding_and_spelling_of_parameters_do_not_matter() {
    with_model
    with_table 0.3333333333
    ends_with 0 run-local samples.txt "$model" runs
    printf '# key, a\r\n9, 3.33333e-1\r\n' >runs/r0_param.txt
    rm started
    ends_with 0 run-local samples.txt "$model" runs
    absent started
}

a_failed_run_leaves_nothing_but_its_log_and_code() {
    with_model
    with_table 1 3 5
    ends_with 0 run-local samples.txt "$model" runs
    same "$(cat runs/r1.status)" 3
    same "$(cat runs/r2.status)" '0 NO_RESULT'
    absent runs/r1_sim.txt runs/r1_param.txt runs/.run
    says '3 rows: 0 complete before, 1 run, 2 failed'
}

a_run_past_its_time_limit_is_ended() {
    with_model
    with_table 4 1
    RUN_TIMEOUT=2 ends_with 0 run-local samples.txt "$model" runs
    same "$(cat runs/r0.status)" '124 TIMEOUT'
    same "$(cat runs/r1.status)" 0
    absent runs/r0_sim.txt
}

# Starts the engine as a process group of its own, and kills that group when so many runs have started.
with_killed_engine() {
    PAUSE=0.3 JOBS=2 setsid run-local samples.txt "$model" runs &
    local group=$!
    until [ -e started ] && [ "$(wc -l <started)" -ge "$1" ]; do sleep 0.01; done
    kill -9 -- "-$group" 2>/dev/null || true
    wait $! 2>/dev/null || true
}

after_a_kill_the_same_call_goes_on() {
    with_model
    with_table 1 2 6 7 8 9 11 12
    PAUSE=0.3 ends_with 0 run-local samples.txt "$model" undisturbed
    rm started
    with_killed_engine 4
    for file in runs/*_sim.txt; do cmp "$file" "undisturbed/${file#runs/}"; done
    local finished
    finished=$(ls runs/*_sim.txt)
    rm started
    ends_with 0 run-local samples.txt "$model" runs
    for file in $finished; do
        file=${file#runs/}
        if grep -x "${file%_sim.txt}" started; then echo 'run again'; return 1; fi
    done
    rm -f runs/*.log undisturbed/*.log
    diff -r runs undisturbed
}

a_killed_engine_takes_its_models_with_it() {
    command -v setpriv >/dev/null || { echo 'setpriv is missing' >reason; exit 77; }
    with_model
    with_table 4.25 4.75
    with_killed_engine 2
    local -i tries=0
    while pgrep -f "$PWD/model"; do
        sleep 0.1
        tries+=1
        [ $tries -lt 100 ] || return 1
    done
}

two_engines_on_one_folder_take_turns() {
    with_model
    with_table 1 2 6
    export PAUSE=1
    run-local samples.txt "$model" runs 2>/dev/null &
    until [ -e started ]; do sleep 0.01; done
    ends_with 0 run-local samples.txt "$model" runs
    wait
    says 'waiting for the runs'
    same "$(wc -l <started)" 3
}

an_engine_needs_no_other_program() {
    with_table 1 2 3
    mkdir bin
    ln -s "$(type -P gl-run)" bin/gl-run
    # shellcheck disable=SC2016  # the model expands it
    printf '#!%s\n%s\n' "$(type -P bash)" 'printf "u f\n0 1\n" >"$1_sim.txt"' >model
    chmod +x model
    PATH=$PWD/bin ends_with 0 "$PWD/bin/gl-run" local samples.txt './model {description}' runs
    says '3 run, 0 failed'
}

each_of_the_processes_may_be_killed() {
    with_model
    with_table 4.25
    local engine
    run-local samples.txt "$model" runs 2>/dev/null &
    engine=$!
    until [ -e started ]; do sleep 0.01; done
    ends_with 0 gl-run status samples.txt runs
    grep -qx $'r0\trunning\t-' out
    kill -9 "$engine"
    wait "$engine" || true
    # The lock is free once the run has ended.
    timeout 60 flock runs true
    if pgrep -f "$PWD/model"; then return 1; fi
    same "$(cat runs/r0.status)" '143 TERMINATED'
    rm started
    run-local samples.txt "$model" runs 2>err &
    engine=$!
    until [ -e started ]; do sleep 0.01; done
    pkill -9 -P "$engine"
    wait "$engine" || true
    says '1 rows were not tried'
    if pgrep -f "$PWD/model"; then return 1; fi
}

a_model_that_leaves_its_group_keeps_the_next_engine_waiting() {
    with_table 1
    # shellcheck disable=SC2016  # the model expands it
    printf '#!/bin/bash\nsetsid sleep 3 &\nsleep 0.2\nprintf "u f\\n0 1\\n" >"$1_sim.txt"\n' >model
    chmod +x model
    ends_with 0 run-local samples.txt './model {description}' runs
    rm runs/r0_sim.txt
    ends_with 0 run-local samples.txt './model {description}' runs
    says 'waiting for the runs'
}

where_all_runs_crashed_the_first_log_is_shown() {
    with_table 1 2
    ends_with 0 run-local samples.txt "sh -c 'echo no licence for {a} >&2; exit 3'" runs
    says '2 failed: r0 (3) r1 (3)'
    says "no run is complete; $PWD/runs/r0.log ends with:"
    says '    no licence for 1'
    PACKED=1 ends_with 0 run-local samples.txt "sh -c 'echo no licence for {a} >&2; exit 3'" packed
    says '    no licence for 1'
}

a_result_that_is_no_run_is_said_and_run_again() {
    with_table 1 2 3
    cat >model <<'END'
#!/bin/bash
case $2 in
    1) printf 'u f\n0 1' >"$1_sim.txt" ;;
    2) printf 'u f\n' >"$1_sim.txt" ;;
    3) printf 'u f\n0 1\n' >"$1_sim.txt"; printf 'a\n4\n' >"$1_param.txt" ;;
esac
END
    chmod +x model
    local packed
    for packed in 0 1; do
        PACKED=$packed ends_with 0 run-local samples.txt './model {description} {a}' "runs$packed"
        says '3 failed: r0 (0 TRUNCATED) r1 (0 EMPTY) r2 (0 PARAMETERS)'
    done
    ends_with 0 gl-run status samples.txt runs0
    same "$(cut -f 1,2 out)" $'sample\tstatus\nr0\ttruncated\nr1\tempty\nr2\tparameters'
}

options_and_the_environment_say_the_same() {
    with_model
    with_table 4.5
    mkdir case
    ends_with 0 gl-run local samples.txt "$PWD/model {description} {a} $PWD" runs --case case --jobs 1 --run-timeout 0.2 --packed
    says 'r0 (124 TIMEOUT)'
    local setting
    for setting in PACKED=yes JOBS=0 JOBS=all RUN_TIMEOUT=soon CASE=nowhere GL_SCRATCH=nowhere; do
        ends_with 2 env "$setting" gl-run local samples.txt "$model" other
        says "${setting#*=}"
        absent other
    done
}

a_log_does_not_fill_the_disk() {
    with_table 1
    ends_with 0 run-local samples.txt "sh -c 'seq 1000000'" runs
    same "$(wc -c <runs/r0.log)" 1000000
}

after_a_full_disk_the_same_call_goes_on() {
    with_model
    with_table 1
    mkdir small
    if ! mount -t tmpfs -o size=64k tmpfs small 2>err; then echo 'a small disk cannot be mounted' >reason; exit 77; fi
    trap 'umount "$PWD/small"' EXIT
    head -c 100000 /dev/zero >small/filler 2>err || true
    if run-local samples.txt "$model" small/runs 2>err; then echo 'no error'; return 1; fi
    absent small/runs/r0_sim.txt
    rm small/filler
    ends_with 0 run-local samples.txt "$model" small/runs
    same "$(cat small/runs/r0_sim.txt)" $'u\tf\n0\t1'
}

packed_runs_are_those_of_loose_files() {
    with_model
    with_table 1.5 2 3 4.5 5 6
    RUN_TIMEOUT=2 ends_with 0 run-local samples.txt "$model" loose
    RUN_TIMEOUT=2 JOBS=1 PACKED=1 ends_with 0 run-local samples.txt "$model" runs
    says '6 rows: 0 complete before, 3 run, 3 failed'
    # One file for two rows a process, and what tells of failures.
    same "$(ls -A runs)" "$(printf '%s\n' r{0,5}_packed.txt r{2,3,4}.log r{2,3,4}.status | sort)"
    ends_with 0 unpack runs/*_packed.txt unpacked
    rm loose/*.log loose/*.status
    diff -r loose unpacked
    rm started
    RUN_TIMEOUT=2 PACKED=1 ends_with 0 run-local samples.txt "$model" runs
    same "$(sort started)" $'r2\nr3\nr4'
    PACKED=yes ends_with 2 run-local samples.txt "$model" runs
    says 'PACKED=yes'
}

of_a_packed_file_that_is_cut_off_the_rest_is_run_again() {
    with_model
    with_table 1 2 6 7
    local size rows
    JOBS=1 PACKED=1 ends_with 0 run-local samples.txt "$model" whole
    size=$(cat whole/*_packed.txt | wc -c)
    ends_with 0 unpack whole/*_packed.txt expected
    for ((left = 0; left < size; left += 17)); do
        rm -rf runs started
        mkdir runs
        cat whole/*_packed.txt | head -c "$left" >runs/r0_packed.txt
        rows=$((left / (size / 4)))
        PACKED=1 ends_with 0 run-local samples.txt "$model" runs
        says "4 rows: $rows complete before, $((4 - rows)) run, 0 failed"
        same "$(wc -l <started)" $((4 - rows))
        rm -rf there
        unpack runs/*_packed.txt there 2>/dev/null || [ $((left % (size / 4))) -gt 0 ]
        diff -r there expected
    done
    # Parameters that are no longer those of the table.
    with_table 1 2 6 7.5
    rm started
    PACKED=1 ends_with 0 run-local samples.txt "$model" runs
    same "$(cat started)" r3
}

a_run_is_taken_packed_or_loose() {
    with_model
    with_table 1 2
    PACKED=1 ends_with 0 run-local samples.txt "$model" runs
    with_table 1 2 6
    ends_with 0 run-local samples.txt "$model" runs
    with_table 1 2 6 7
    PACKED=1 ends_with 0 run-local samples.txt "$model" runs
    same "$(sort started | uniq -c | tr -s ' ')" $' 1 r0\n 1 r1\n 1 r2\n 1 r3'
}

what_else_a_packed_run_writes_stays_beside() {
    with_table 1
    PACKED=1 ends_with 0 run-local samples.txt "sh -c 'printf \"u f\\n0 1\\n\" | tee {description}_sim.txt >{description}_grains.txt'" runs
    same "$(ls -A runs)" $'r0_grains.txt\nr0_packed.txt'
}

loose_runs_can_be_packed_afterwards() {
    with_model
    with_table 1 2 3
    ends_with 0 run-local samples.txt "$model" runs
    cp -r runs loose
    ends_with 0 gl-run pack runs
    says '2 runs packed'
    same "$(ls -A runs)" $'r0_packed.txt\nr2.log\nr2.status'
    rm started
    ends_with 0 run-local samples.txt "$model" runs
    same "$(cat started)" r2
    ends_with 0 gl-run unpack runs/r0_packed.txt unpacked
    for file in unpacked/*; do cmp "$file" "loose/${file#*/}"; done
    ends_with 2 gl-run pack nowhere
}

damage_in_a_packed_file_is_said_when_it_is_unpacked() {
    printf '%s\n' '# file a_sim.txt 4' 'u' '1' '' '# file ../b_sim.txt 2' 1 '' >x_packed.txt
    ends_with 2 unpack x_packed.txt there
    says 'x_packed.txt:5: no file of a run begins here'
    same "$(cat there/a_sim.txt)" $'u\n1'
    absent b_sim.txt
    printf '# file a_sim.txt 9\nu\n1\n' >y_packed.txt
    ends_with 2 unpack y_packed.txt other
    says 'y_packed.txt:3: cut off in a_sim.txt'
    absent other/a_sim.txt
}

the_measurements_are_what_their_scripts_make() {
    cp -r "$ROOT/examples" .
    local name
    needs python3 python3
    for name in linear hyperbola oscillator norsand triaxial-tests triaxial-element-tests; do
        find "examples/$name" -name '*.txt' ! -name params.txt -delete
        "examples/$name/make-obs"
        diff -r "examples/$name" "$ROOT/examples/$name"
    done
}

facts "$@"
