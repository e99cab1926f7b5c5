#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
export TERM=xterm

# Runs of which one comes late: its file is a pipe that nobody writes into for a while.
with_a_late_run() {
    local name
    printf 'x y\n0 0\n1 1\n' >obs.txt
    printf 'description a\none 1\ntwo 2\n' >samples.txt
    mkdir -p runs
    printf 'a\n1\n' >runs/one_param.txt
    printf 'a\n2\n' >runs/two_param.txt
    printf 'x y\n0 0\n1 1\n' >runs/one_sim.txt
    rm -f runs/two_sim.txt
    mkfifo runs/two_sim.txt
    (sleep 3; printf 'x y\n0 0\n1 2\n' >runs/two_sim.txt) &
}

# A design of which 150 runs are called the measurement in turn: two seconds on two processors.
with_a_self_check() {
    printf 'name lower upper effect off\na 0 2 - -\nbend 0.1 2 bending 0\n' >params.txt
    gl-sample -p params.txt -n 200 --effects switch -o samples.txt
    awk 'BEGIN { print "sample step x y" }
        NR > 1 { for (i = 0; i < 20; i++) print $1, i, i, $3 * i + $4 * i * i / 20 }' samples.txt >runs.txt
    awk 'BEGIN { print "x y"; for (i = 0; i < 20; i++) print i, i + 0.05 * i * i + 0.1 * sin(9 * i) }' >obs.txt
    check='gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y --noise y=0.1 --self-check 150 runs.txt'
}

collect='gl-collect -s samples.txt -b obs.txt -c x -v y runs'

a_terminal_shows_how_far_a_tool_has_come_and_the_line_goes_again() {
    needs script script
    with_a_late_run
    script -qec "$collect -o ensemble.txt" typescript
    grep -q 'gl-collect: reading runs .* 1 of 2' typescript
    # What the line ends with, before the last words of script: back to its begin, and erased.
    same "$(tr -d '\n' <typescript | grep -c $'\r\033\\[2KScript done')" 1
    same "$(wc -l <ensemble.txt)" 5
}

a_self_check_shows_itself_and_not_its_parts() {
    needs script script
    with_a_self_check
    script -qec "$check -o attribution.txt" typescript
    grep -q 'gl-gap-attribute: checking itself .* of 150, about [0-9]* s left' typescript
    # Its emulators and hypotheses have lines of their own only before it.
    same "$(sed -n '/checking itself/,$p' typescript | grep -c 'weighing hypotheses\|training the emulator')" 0
}

a_pipe_gets_nothing_of_it() {
    with_a_late_run
    $collect 2>err >ensemble.txt
    same "$(cat err)" ''
    with_a_self_check
    $check 2>err >attribution.txt
    same "$(grep -c $'\r\\|\033' err attribution.txt)" "err:0
attribution.txt:0"
}

a_terminal_that_cannot_erase_gets_nothing_of_it() {
    needs script script
    with_a_late_run
    TERM=dumb script -qec "$collect -o ensemble.txt" typescript
    same "$(grep -c 'reading runs' typescript)" 0
}

facts "$@"
