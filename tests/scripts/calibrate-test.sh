#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
unset ITERATIONS MORE UNTIL NUM SEED ENGINE OUT MAKEFLAGS MAKELEVEL

with_case() {
    mkdir case
    cp "$ROOT"/examples/linear/{params.txt,obs.txt,linear.awk} case/
    sed 's/^NUM=.*/NUM=8/; s/^ITERATIONS=.*/ITERATIONS=1/' "$ROOT/examples/linear/case.env" >case/case.env
}

# What is built is taken as it is.
with_make() {
    mkdir bin
    printf '#!/bin/sh\n' >bin/cargo
    chmod +x bin/cargo
    PATH=$PWD/bin:$PATH
}

with_same_tables() {
    local file
    for file in "$1"/*.txt "$1"/iter*/*.txt; do cmp "$file" "$2/${file#"$1"/}"; done
}

settings_of_the_environment_win_over_those_of_the_case() {
    with_case
    with_make
    export NUM=12 SEED=5 ITERATIONS=2
    calibrate case local by-environment
    unset NUM SEED ITERATIONS
    make -C "$ROOT" calibrate CASE="$PWD/case" ENGINE=local OUT="$PWD/by-make" NUM=12 SEED=5 ITERATIONS=2
    with_same_tables by-environment by-make
    printf '%s\n' NUM=12 SEED=5 ITERATIONS=2 >>case/case.env
    calibrate case local by-case
    same "$(cd by-case && echo iter*)" 'iter0 iter1'
    with_same_tables by-environment by-case
}

other_settings_are_computed_anew_and_the_same_are_not() {
    with_case
    calibrate case local fit
    touch before
    NUM=10 ends_with 0 calibrate case local fit
    same "$(grep -c . fit/iter0/samples.txt)" 11
    touch after
    # Eight of the samples are the same.
    same "$(find fit/iter0/runs -name '*_sim.txt' -newer before | wc -l)" 2
    NUM=10 ends_with 0 calibrate case local fit
    same "$(find fit -name '*.txt' -newer after)" ''
}

an_effect_of_the_environment_wins_too() {
    cp -r "$ROOT/examples/contact-effects" case
    printf '%s\n' NUM=8 ITERATIONS=1 EFFECTS= >>case/case.env
    EFFECTS=adhesion ends_with 0 calibrate case embedded fit
    # Without its effect the parameter stands still.
    same "$(awk 'NR == 1 { for (j = 1; j <= NF; j++) if ($j == "w") w = j; next } !seen[$w]++' fit/iter0/samples.txt | wc -l)" 8
}

paths_that_make_cannot_take_are_refused_before_anything_runs() {
    with_case
    with_make
    local path
    mkdir cases
    # shellcheck disable=SC2016  # the point is that nobody expands it
    for path in 'a b' 'a:b' 'a$b' 'a%b' 'a#b' "a'b" 'a=b'; do
        cp -r case "cases/$path"
        ends_with 2 calibrate "cases/$path" local fit
        says "cases/$path: make cannot take a path"
        ends_with 2 calibrate case local "$path"
        says "$path: make cannot take a path"
        ends_with 2 one-iteration "cases/$path" case/params.txt case fit
        says "cases/$path: make cannot take a path"
        absent "$path" fit
    done
    for path in calibrate submit diagnose; do
        ends_with 2 make -C "$ROOT" "$path" CASE="$PWD/cases/a b" OUT="$PWD/fit"
        says "CASE=$PWD/cases/a b: a path with blanks cannot go through make"
        ends_with 2 make -C "$ROOT" "$path" CASE="$PWD/case" OUT="$PWD/a fit"
        says "OUT=$PWD/a fit: a path with blanks"
        absent fit 'a fit' a
    done
    # Where it was called from does not matter.
    cd 'cases/a b'
    ends_with 0 calibrate . local fit
}

a_calibration_by_lammps_is_that_of_the_embedded_simulator() {
    needs lammps lmp
    export ITERATIONS=2
    calibrate "$ROOT/examples/collision" embedded embedded
    MODEL='lmp -in {case}/lammps.in -log none -screen none -var E_m {E_m} -var nu {nu} -var name {description}' \
        calibrate "$ROOT/examples/collision" local lammps
    # Means, deviations and quantiles.
    paste embedded/posterior.txt lammps/posterior.txt | awk -F '\t' '
        /^(mean|sd|q05|q95)[(]/ { rows++; if ($1 != $3 || ($2 / $4 - 1)^2 > 1e-8) { print; exit 1 } }
        END { if (rows != 8) exit 1 }'
}

facts "$@"
