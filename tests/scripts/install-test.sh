#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
unset ITERATION MAKEFLAGS MAKELEVEL

# The project without its sources; what is built is taken as it is.
with_project() {
    mkdir -p bin project/target
    printf '#!/bin/sh\n' >bin/cargo
    chmod +x bin/cargo
    cp -r "$ROOT"/{Makefile,scripts,examples,tools} project
    ln -s "${GL_BIN:-$ROOT/target/release}" project/target/release
    PATH=$PWD/bin:/usr/bin:/bin
}

installed_scripts_find_the_tools_and_each_other_from_anywhere() {
    with_project
    make -s -C project install PREFIX="$PWD/usr"
    local share=$PWD/usr/share
    same "$(cd project/tools && ls -d gl-*)" "$(ls usr/bin)"
    same "$(find "$share/man/man1" -name 'gl-*.1' | wc -l)" "$(find usr/bin -type f | wc -l)"
    grep -q 'gl-sample' "$share/bash-completion/completions/gl-sample"
    rm -r project bin
    mkdir elsewhere
    cd elsewhere
    PATH=/usr/bin:/bin
    ends_with 0 "$share/gl/scripts/calibrate" "$share/gl/examples/collision" embedded fit
    grep -q '^E_m' out
    "$share/gl/scripts/run-local" --help | grep -q 'gl-run local .*<SAMPLES> <MODEL> <DIR>'
    ends_with 0 "$share/gl/scripts/report-html" "$share/gl/examples/collision" embedded fit
    [ -s fit/report.html ]
}

tools_in_path_come_before_those_of_the_scripts() {
    with_project
    mkdir first
    printf '#!/bin/sh\necho "mine: $*"\nexit 2\n' >first/gl-sample
    chmod +x first/gl-sample
    PATH=$PWD/first:$PATH ends_with 2 project/scripts/calibrate project/examples/linear local fit
    grep -q '^mine: -p' out
}

make_iteration_goes_from_runs_to_the_next_samples() {
    with_project
    PATH=$PATH:$PWD/project/target/release
    cd project
    gl-sample -p examples/collision/params.txt -n 30 --name collision -o samples.txt
    gl-contact -s samples.txt runs
    # Go on is no error here.
    ends_with 0 make iteration CASE=examples/collision SAMPLES=samples.txt RUNS=runs OUT=fit
    grep -qx 'next samples: fit/iter1/samples.txt' out
    gl-contact -s fit/iter1/samples.txt runs
    ends_with 0 make iteration CASE=examples/collision SAMPLES=fit/iter1/samples.txt RUNS=runs OUT=fit ITERATION=1
    [ -s fit/iter2/samples.txt ]
    ends_with 2 make iteration CASE=examples/collision SAMPLES=nowhere.txt RUNS=runs OUT=fit
    says 'nowhere.txt: no such samples table'
}

facts "$@"
