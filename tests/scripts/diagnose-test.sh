#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
export MAKE=make

with_parameters() {
    printf 'name lower upper scale effect off\na 0 10 - - -\nb 1 10000 log - -\nc 0 1 - extra 0\n' >params.txt
}

# Whether column 2 and 3 of a row are these numbers.
with_bounds() {
    awk -v name="$2" -v low="$3" -v high="$4" '
        function near(a, b) { return (a > b ? a - b : b - a) <= 1e-5 * b }
        $1 == name { found = 1; if (!near($2, low) || !near($3, high)) { print; exit bad = 1 } }
        END { exit bad || !found }
    ' "$1"
}

a_design_lies_between_the_runs_that_fit_about_as_well_as_the_best() {
    with_parameters
    # 9.1 times the least misfit is more than three times its root.
    printf 'sample a b c misfit weight\nr0 4 10 0 10 0\nr1 7 100 0 1 1\nr2 4 1000 0 9 0\nr3 1 1 0 9.1 0\n' >weights.txt
    awk -f "$ROOT/scripts/narrow.awk" params.txt weights.txt >box.txt
    # From 4 to 7 on, half as wide again.
    with_bounds box.txt a 3.25 7.75
    with_bounds box.txt b 56.2341 1778.28
    with_bounds box.txt c 0 1
    same "$(head -n 1 box.txt | tr '\t' ' ')" 'name lower upper scale effect off'
}

a_design_keeps_a_quarter_of_the_prior_and_stays_inside_it() {
    with_parameters
    printf 'sample a b c misfit weight\nr0 9.5 100 0 1 1\nr1 1 9000 0 1000 0\n' >weights.txt
    awk -f "$ROOT/scripts/narrow.awk" params.txt weights.txt >box.txt
    with_bounds box.txt a 8.25 10
    with_bounds box.txt b 31.6228 316.228
}

a_box_grows_where_a_hypothesis_leans_on_it_and_nowhere_else() {
    with_parameters
    printf 'name lower upper scale effect off\na 3 7 - - -\nb 10 100 log - -\nc 0 1 - extra 0\n' >box.txt
    printf 'hypothesis parameter mean sd q05 q95 lean\nnone a 3 1 3 4 -1\nextra b 9 1 9 9 1\nextra c 0 1 0 0 -1\nnone b 5 1 1 1 0\n' >posterior.txt
    awk -f "$ROOT/scripts/widen.awk" params.txt box.txt posterior.txt >wider.txt
    with_bounds wider.txt a 0 7
    with_bounds wider.txt b 10 1000
    with_bounds wider.txt c 0 1
    sed -i 's/ -\{0,1\}1$/ 0/' posterior.txt
    awk -f "$ROOT/scripts/widen.awk" params.txt box.txt posterior.txt | tr '\t' ' ' | cmp - box.txt
}

a_prior_that_is_wide_beside_the_measurement_does_not_hide_the_effect() {
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^E_m.*/E_m\t7\t11\t-\t-\t-\t-/; s/^mu.*/mu\t0.01\t2\tlog\t-\t-\t-/' case/params.txt
    # What calibration does not see is measured apart.
    echo 'STEPS=0:60' >>case/case.env
    make -s -f "$ROOT/scripts/diagnose.mk" CASE=case ENGINE=embedded OUT=made made/report.md >log 2>&1
    same "$(sed -n 2p made/attribution.txt | cut -f 1)" adhesion
    awk 'NR > 1 && $2 < 2 { exit bad = 1 } END { exit bad }' <(awk '$1 == "E_m" { print $1, 4 / ($3 - $2) }' made/design/params.txt)
    grep -q 'calibrations did not see (they saw .0:60.)' made/report.md
    awk -F '\t' '$1 == "all" { found = $5 > 0.5 } END { exit !found }' made/shrink-unseen.txt
}

# The folder of the last round of the design.
with_last_round() { find made/design -mindepth 1 -name 'round*' | sort | tail -n 1; }

settings_of_the_environment_win_in_the_design_too() {
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^NUM=.*/NUM=20/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    echo DESIGN_NUM=90 >>case/case.env
    DESIGN_NUM=60 make -s -f "$ROOT/scripts/diagnose.mk" CASE=case ENGINE=embedded OUT=made made/attribution.txt >log 2>&1
    # Three fifths in the first round, and the others last.
    same "$(wc -l <made/design/round0/samples.txt)" 37
    same "$(wc -l <"$(with_last_round)/samples.txt")" 25
}

the_last_runs_of_a_design_lie_where_the_first_ones_point() {
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^NUM=.*/NUM=20/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    make -s -f "$ROOT/scripts/diagnose.mk" CASE=case ENGINE=embedded OUT=made DESIGN_NUM=100 made/attribution.txt >log 2>&1
    spread() {
        awk '$1 == "description" { for (j = 1; j <= NF; j++) if ($j == "E_m") at = j; next }
            { n++; sum += $at; squares += $at * $at }
            END { printf "%.9f", sqrt(squares / n - (sum / n) ^ 2) }' "$1"
    }
    awk -v first="$(spread made/design/round0/samples.txt)" -v last="$(spread "$(with_last_round)/samples.txt")" \
        'BEGIN { exit !(last < 0.7 * first) }'
    same "$(($(wc -l <made/design/samples.txt) - 1))" "$(cut -f 1 made/design/ensemble.txt | sort -u | grep -vc '^sample$')"
}

a_diagnosis_goes_on_where_it_was() {
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^NUM=.*/NUM=20/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    made() { make -s -f "$ROOT/scripts/diagnose.mk" CASE=case ENGINE=embedded OUT=made DESIGN_NUM=60 made/report.md; }
    made >log 2>&1
    cp made/attribution.txt first.txt
    rm made/attribution.txt made/design/ensemble.txt made/design/round*/attribution.txt
    touch marker
    made >log 2>&1
    cmp first.txt made/attribution.txt
    same "$(find made -newer marker -name '*_sim.txt' | wc -l)" 0
}

facts "$@"
