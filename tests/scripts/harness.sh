# shellcheck shell=bash
# A test is a function whose name states a fact; it fails when a command in it fails. Sourced first by a
# file of tests, whose last line is `facts "$@"`: all of them, or those whose names a pattern matches; `--list` says which
# there are. Each test starts in an empty folder of its own, and what it says comes in one piece.

ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
export PATH=$ROOT/scripts:$PATH:$ROOT/target/release
unset CASE JOBS RUN_TIMEOUT GL_SCRATCH
before=$(declare -F)

# needs WHAT PROGRAM...: skip the test where a program is missing; that fails with GL_REQUIRE=WHAT,….
needs() {
    local what=$1 program
    shift
    for program; do
        command -v "$program" >/dev/null && continue
        [[ ,${GL_REQUIRE:-}, != *,$what,* ]] || { echo "$program is missing, and GL_REQUIRE names $what"; exit 1; }
        echo "$program is missing" >reason
        exit 77
    done
}

# Tests that a command ends with this code; its output stays in `out` and `err`.
ends_with() {
    local expected=$1 status=0
    shift
    "$@" >out 2>err || status=$?
    [ "$status" -eq "$expected" ] || { echo "exit $status, not $expected: $*"; cat err; return 1; }
}

says() { grep -qF -- "$1" err || { echo "not said: $1"; cat err; return 1; }; }
same() { [ "$1" = "$2" ] || { printf 'found    %s\nexpected %s\n' "$1" "$2"; return 1; }; }
absent() {
    local file
    for file; do [ ! -e "$file" ] || { echo "$file is there"; return 1; }; done
}

# A SLURM of one node for this test alone, in the folder slurm.
with_slurm() {
    needs slurm sbatch slurmctld slurmd munged
    [ "$(id -u)" = 0 ] || { echo 'a private SLURM needs root' >reason; exit 77; }
    export SLURM_TEST_DIR=$PWD/slurm SLURM_TEST_CPUS=4
    # Others on this machine may test too, and so may others of this run.
    export SLURM_TEST_PORT=$((20000 + $$ % 5000 * 2))
    until exec 8>"$SHARED/port$SLURM_TEST_PORT" && flock -n 8; do SLURM_TEST_PORT=$((SLURM_TEST_PORT + 2)); done
    mkdir slurm home
    # Tasks are login shells: what a person's profile does, and waits for when a task was killed in it, is not tested.
    export HOME=$PWD/home
    # munged wants its socket where everybody may look.
    chmod 755 .
    trap '"$ROOT/tests/slurm/stop.sh"' EXIT
    "$ROOT/tests/slurm/start.sh"
    # shellcheck source=/dev/null
    . slurm/env.sh
}

# What several tests begin with is made once for all of them: the command, in a folder of this name, of which each gets a copy.
with_shared() {
    local made=$SHARED/$1
    shift
    (
        flock 9
        [ -e "$made" ] && exit
        rm -rf "$made.part"
        mkdir "$made.part"
        cd "$made.part"
        "$@"
        mv "$made.part" "$made"
    ) 9>"$made.lock"
    cp -r "$made/." .
}

facts() {
    local name folder status start failed=0
    if [ -z "${SHARED-}" ]; then
        SHARED=$(mktemp -d)
        export SHARED
        trap 'rm -rf "$SHARED"' EXIT
    fi
    for name in $(declare -F | awk '{ print $3 }' | grep -vxFf <(awk '{ print $3 }' <<<"$before")); do
        case $name in needs | ends_with | says | same | absent | facts | with_* | is_* | cleanup) continue ;; esac
        if [ "${1-}" = --list ]; then echo "$name"; continue; fi
        # shellcheck disable=SC2053  # a pattern
        [[ $name == ${1:-*} ]] || continue
        folder=$(mktemp -d)
        status=0 start=$SECONDS
        # Not under `if` or `||`, which would switch off -e within.
        (cd "$folder" && set -eu && "$name") >"$folder.log" 2>&1 &
        wait $! || status=$?
        # What is slow says how slow.
        case $status in
            0) echo "ok $name$([ $((SECONDS - start)) -lt 5 ] || echo ", $((SECONDS - start)) s")" ;;
            77) echo "skip $name: $(cat "$folder/reason")" ;;
            *)
                printf 'FAIL %s\n%s\n' "$name" "$(sed 's/^/    /' "$folder.log")"
                failed=1
                ;;
        esac
        rm -rf "$folder" "$folder.log"
    done
    return "$failed"
}
