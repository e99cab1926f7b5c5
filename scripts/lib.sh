# shellcheck shell=bash
# What the run-* scripts share: read and check the samples table, find the rows whose run is
# missing, check the model. Sourced, not run.

set -euo pipefail
export LC_ALL=C
ME=${0##*/}
HERE=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# Where no tools are in PATH: those that were built or installed with this script.
PATH=$PATH:$HERE/../target/release:$HERE/../../../bin

say() { printf '%s: %s\n' "$ME" "$*" >&2; }
die() { say "$*"; exit 2; }

# put FILE: standard input into FILE, which keeps its time if it is the same already.
put() {
    cat >"$1.part"
    if cmp -s "$1.part" "$1"; then rm "$1.part"; else mv "$1.part" "$1"; fi
}

# The comment at the top of the script that was called.
usage() { sed -n '2,/^$/s/^# \{0,1\}//p' "$0"; }

# check_paths FOLDER...: those that go through make, where some characters mean something whatever is done.
check_paths() {
    local path
    for path in "$@" "$HERE"; do
        [ "$(tr -d ' \t\n$#:%;\47"\\*?[]|&<>\140=()~' <<<"$path")" = "$path" ] ||
            die "$path: make cannot take a path with blanks or special characters; use another name, or go there and give a relative one"
    done
}

# settings: those settings of a case that the environment has, which win over case.env; KEY=VALUE lines.
settings() {
    local key
    for key in $(sed -n 's/^SETTINGS [:+]= //p' "$HERE/columns.mk"); do
        [ -z "${!key-}" ] || printf '%s=%s\n' "$key" "${!key//$'\n'/ }"
    done
}

# until_more OUT MORE: how many iterations it has with so many beyond those that are there.
until_more() {
    local there=0
    [[ $2 =~ ^[1-9][0-9]*$ ]] || die "MORE=$2: give a number of iterations from 1"
    while [ -e "$1/iter$there/stop.code" ]; do there=$((there + 1)); done
    printf '%s\n' $((there + $2))
}

# arguments "$@": the call that all engines share, SAMPLES MODEL DIR.
# Sets and exports what run-row reads: GL_TABLE, GL_MODEL, GL_DIR and CASE, with absolute paths; and
# TABLE, the text of the table, for open_dir.
arguments() {
    case ${1-} in -h | --help) usage; exit 0 ;; esac
    [ $# -eq 3 ] || die "needs SAMPLES MODEL DIR; see $ME --help"
    SAMPLES=$1
    if [ ! -r "$SAMPLES" ] || [ -d "$SAMPLES" ]; then
        die "$SAMPLES: no such samples table; gl-sample writes one"
    fi
    CASE=$(cd "${CASE:-.}" && pwd) || die "CASE: no such folder"
    TABLE=$(canonical_table "$SAMPLES") || exit 2
    check_model "$2"
    mkdir -p "$3" || die "$3: cannot be made"
    GL_DIR=$(cd "$3" && pwd)
    GL_TABLE=$GL_DIR/.run/samples.txt
    export CASE GL_TABLE GL_MODEL GL_DIR
    # Yade scripts import gl_yade from here.
    export PYTHONPATH=$HERE${PYTHONPATH:+:$PYTHONPATH}
}

# packing YES: sets and exports GL_PACKED for run-row, from what a user calls PACKED.
packing() {
    case $1 in '' | 0 | 1) ;; *) die "PACKED=$1: give 1 for packed runs, or 0" ;; esac
    export GL_PACKED=${1#0}
}

# Take DIR for this engine: nothing else runs there any more, so that what is left in .run belongs to
# runs that were killed.
open_dir() {
    lock_dir
    [ ! -e "$GL_DIR/.run/jobs" ] ||
        die "$GL_DIR: $(cat "$GL_DIR/.run/engine") has runs in the queue; call it again to wait for them"
    rm -rf "$GL_DIR/.run"
    mkdir "$GL_DIR/.run"
    printf '%s\n' "$TABLE" >"$GL_TABLE"
}

# Hold DIR until the last process that was started for it has ended. A model that outlives a killed
# engine inherits the lock, so that nothing is run a second time beside it.
lock_dir() {
    command -v flock >/dev/null || return 0
    exec 9<"$GL_DIR"
    local status=0
    flock -n 9 || status=$?
    if [ "$status" -eq 1 ]; then
        say "$GL_DIR: waiting for the runs that another process has started there"
        flock 9
    elif [ "$status" -ne 0 ]; then
        say "$GL_DIR: this file system has no locks; start one engine at a time here"
    fi
}

# tie SIGNAL: sets tied, the prefix for a command that is to get SIGNAL when this script is killed.
# shellcheck disable=SC2034  # it is the callers that use it
tie() {
    tied=()
    if setpriv --pdeathsig "$1" true 2>/dev/null; then tied=(setpriv --pdeathsig "$1"); fi
}

# canonical_table FILE: the table as Yade reads it (tabs, bare header, a newline after the last row),
# on stdout, once every cell is known to be harmless. Yade evaluates cells as Python.
canonical_table() {
    ME=$ME SOURCE=$1 awk '
        function fail(text) {
            printf "%s: %s:%d: %s\n", ENVIRON["ME"], ENVIRON["SOURCE"], NR, text > "/dev/stderr"
            failed = 1
            exit 2
        }
        function split_line(text) {
            gsub(/^[ \t]+|[ \t]+$/, "", text)
            if (separator == " ") return split(text, field, /[ \t]+/)
            count = split(text, field, separator)
            for (j = 1; j <= count; j++) gsub(/^[ \t]+|[ \t]+$/, "", field[j])
            return count
        }
        function check_header(    j) {
            for (j = 1; j <= columns; j++) {
                name[j] = field[j]
                if (name[j] !~ /^([A-Za-z_][A-Za-z0-9_]*|!OMP_NUM_THREADS)$/)
                    fail("\"" name[j] "\" cannot be a column name; use letters, digits and _")
                if (name[j] == "dir" || name[j] == "case")
                    fail("column " name[j] ": this name stands for a folder; call the parameter otherwise")
                if (name[j] in place) fail("column " name[j] " is there more than once")
                place[name[j]] = j
            }
            if (!("description" in place)) fail("no column description; gl-sample writes one")
        }
        function check_description(text) {
            if (text !~ /^[A-Za-z0-9_.,=+@:-]+$/ || text ~ /^[-.]/ || text ~ /\.\./ || text == "=" || length(text) > 200)
                fail("column description: \"" text "\" cannot name a run; use at most 200 letters, digits and _ - . , = + @ : (no leading - or ., no ..)")
            if (text in seen) fail("column description: " text " is on line " seen[text] " already")
            seen[text] = NR
        }
        { sub(/\r$/, "") }
        NR == 1 { sub(/^\357\273\277/, "") }
        /^[ \t]*$/ { next }
        !columns {
            sub(/^[ \t]*#*/, "")
            separator = index($0, "\t") ? "\t" : index($0, ",") ? "," : " "
            columns = split_line($0)
            check_header()
        }
        /^[ \t]*#/ { next }
        columns && rows++ {
            count = split_line($0)
            if (count != columns && separator != " ") {
                separator = " "
                count = split_line($0)
            }
            if (count != columns) fail(count " fields where the header names " columns)
            for (j = 1; j <= columns; j++) {
                if (name[j] == "description") check_description(field[j])
                else if (name[j] == "!OMP_NUM_THREADS" && field[j] !~ /^[1-9][0-9]*$/)
                    fail("column !OMP_NUM_THREADS: \"" field[j] "\" is no number of threads")
                else if (field[j] !~ /^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$/)
                    fail("column " name[j] ": \"" field[j] "\" is not a number")
                # To Python, which Yade reads cells with, 007 is no number.
                else if (field[j] ~ /^[+-]?0+[0-9]+$/) sub(/0+/, "", field[j])
            }
        }
        {
            for (j = 1; j <= columns; j++) printf "%s%s", field[j], j < columns ? "\t" : "\n"
        }
        END { if (!failed && !columns) { NR = 1; fail("no header; the first line must name the columns") } }
    ' <"$1"
}

# missing_rows all|LINE...: line numbers, in GL_TABLE, of those rows whose run is not complete. Complete is:
# both files are there, packed or not, the simulation has rows and a newline at its end, and the
# parameters are the row's.
missing_rows() {
    packed_files "$@" | DIR=$GL_DIR LINES_TO_CHECK=$* awk -F '\t' '
        function slurp(path,    text) {
            if ((getline text < path) <= 0) text = ""
            close(path)
            return text
        }
        function has_rows(text) {
            return index(text, "\n") < length(text) && substr(text, length(text)) == "\n"
        }
        # Both rounded, perhaps differently, by whoever wrote them.
        function same(a, b,    size) {
            size = a < 0 ? -a : a
            if (size < (b < 0 ? -b : b)) size = b < 0 ? -b : b
            return (a > b ? a - b : b - a) <= 1e-5 * size
        }
        function has_parameters(text, row,    lines, names, used, cells, value, j, n) {
            gsub(/\r/, "", text)
            split(text, lines, "\n")
            sub(/^[ \t]*#[ \t]*/, "", lines[1])
            n = split(lines[1], names, /[ \t,]+/)
            split(lines[2], used, /[ \t,]+/)
            for (j = 1; j <= n; j++) value[names[j]] = used[j]
            split(row, cells, "\t")
            for (j = 1; j <= columns; j++) {
                if (name[j] ~ /^(description|key|!OMP_NUM_THREADS)$/) continue
                if (!(name[j] in value) || !same(value[name[j]] + 0, cells[j] + 0)) return 0
            }
            return 1
        }
        # Ticks off the rows whose run is in a packed file, up to where the file is cut off.
        function look_into(path,    line, word, text, parameters, bytes, lines, i) {
            while ((getline line < path) > 0 && split(line, word, " ") == 4 && word[1] word[2] == "#file") {
                text = ""
                bytes = lines = 0
                while (bytes < word[4] && (getline line < path) > 0) {
                    bytes += length(line) + 1
                    if (lines++ < 2) text = text line "\n"
                }
                if (bytes < word[4]) break
                # A line end follows, which is the last one where the file itself has none.
                if (bytes == word[4] && (getline line < path) <= 0) break
                if (sub(/_param\.txt$/, "", word[3])) {
                    parameters[word[3]] = text
                } else if (bytes == word[4] && lines > 1 && sub(/_sim\.txt$/, "", word[3])) {
                    i = place[word[3]]
                    if (i in row && has_parameters(parameters[word[3]], row[i])) delete row[i]
                    delete parameters[word[3]]
                }
            }
            close(path)
        }
        BEGIN {
            all = ENVIRON["LINES_TO_CHECK"] == "all"
            for (j = split(ENVIRON["LINES_TO_CHECK"], wanted, " "); j; j--) check[wanted[j]]
        }
        NR == 1 {
            columns = NF
            for (j = 1; j <= NF; j++) { name[j] = $j; if ($j == "description") description = j }
            next
        }
        FNR != NR { look_into($0); next }
        all || NR in check { row[NR] = $0; place[$description] = NR }
        { rows = NR }
        END {
            RS = "\001"  # a whole file is one record
            for (i = 2; i <= rows; i++) {
                if (!(i in row)) continue
                split(row[i], cell, "\t")
                base = ENVIRON["DIR"] "/" cell[description]
                if (!has_rows(slurp(base "_sim.txt")) || !has_parameters(slurp(base "_param.txt"), row[i])) print i
            }
        }
    ' "$GL_TABLE" -
}

# packed_files all|LINE...: the packed files in which runs of these rows can be: those that begin with one
# of them, since a task packs its own rows.
packed_files() {
    if [ "$*" = all ]; then
        find "$GL_DIR" -maxdepth 1 -name '*_packed.txt'
        return
    fi
    local line
    read_rows "$@"
    for line; do
        read_row "$line"
        own_packs
    done
}

# own_packs: the packed files that begin with the run `description`, and then the name of the next one.
own_packs() {
    local number=1 file=$GL_DIR/${description}_packed.txt
    while [ -e "$file" ]; do
        printf '%s\n' "$file"
        number=$((number + 1))
        file=$GL_DIR/$description.${number}_packed.txt
    done
    printf '%s\n' "$file"
}

# read_rows LINE...: sets columns, their names, and row[LINE], these rows of GL_TABLE.
read_rows() {
    local number text
    IFS=$'\t' read -ra columns <"$GL_TABLE"
    declare -gA row=()
    while IFS=$'\t' read -r number text; do row[$number]=$text; done < <(
        # The header, so that there is something to look for.
        printf '%s\n' 1 "$@" |
            awk 'NR == FNR { wanted[$1]; left++; next } FNR in wanted { print FNR "\t" $0; if (!--left) exit }' - "$GL_TABLE"
    )
}

# read_row LINE: sets cell[NAME] and description, from a row that read_rows has read.
read_row() {
    local fields j
    [ -n "${row[$1]-}" ] || die "$GL_TABLE: no line $1"
    IFS=$'\t' read -ra fields <<<"${row[$1]}"
    unset cell
    declare -gA cell
    for j in "${!columns[@]}"; do cell[${columns[j]}]=${fields[j]}; done
    description=${cell[description]}
}

# check_model MODEL: sets GL_MODEL, or dies, before anything has run.
check_model() {
    local names placeholder program
    GL_MODEL=$1
    [[ $GL_MODEL == *[![:space:]]* ]] || die "MODEL is empty; see $ME --help"
    if is_yade "$GL_MODEL"; then
        GL_MODEL=$(script_path "$GL_MODEL") || exit 2
        command -v yade >/dev/null || die "yade is not installed, which $1 needs: apt-get install yade"
        return
    fi
    xargs printf '%s\0' <<<"$GL_MODEL" >/dev/null 2>&1 || die "MODEL: a quote is not closed: $GL_MODEL"
    names=${TABLE%%$'\n'*}
    names=" ${names//$'\t'/ } dir case "
    while read -r placeholder; do
        [[ $names == *" $placeholder "* ]] ||
            die "MODEL: {$placeholder} is no column of $SAMPLES; the columns are$names"
    done < <(grep -o '{[A-Za-z_][A-Za-z0-9_]*}' <<<"$GL_MODEL" | tr -d '{}')
    model_words
    program=${words[0]//'{case}'/"$CASE"}
    [[ $program == *'{'* ]] || command -v -- "$program" >/dev/null || die "MODEL: no program $program"
}

# A Yade script is one word that ends in .py, or a file of that name with blanks.
is_yade() { [[ $1 == *.py ]] && { [[ $1 != *[[:space:]]* ]] || [ -f "$1" ]; }; }

# script_path FILE: where it is, in CASE or from here.
script_path() {
    local file
    for file in "$CASE/$1" "$1"; do
        if [ -f "$file" ]; then printf '%s/%s\n' "$(cd "$(dirname "$file")" && pwd)" "${1##*/}"; return; fi
    done
    die "$1: no such script, neither in $CASE nor here"
}

# model_words: GL_MODEL as an array of words; quotes group, nothing is expanded.
model_words() { mapfile -d '' -t words < <(xargs printf '%s\0' <<<"$GL_MODEL"); }

# report BEFORE...: how it went, from the line numbers that were missing before. Fails if a row was
# not even tried.
report() {
    local line missing tried=$# rows failed=0 untried=0 names=''
    rows=$(($(wc -l <"$GL_TABLE") - 1))
    mapfile -t missing < <(missing_rows all)
    read_rows "${missing[@]}"
    for line in "${missing[@]}"; do
        read_row "$line"
        # A status older than the table is that of an earlier call.
        if [ -e "$GL_DIR/$description.status" ] && [ ! "$GL_TABLE" -nt "$GL_DIR/$description.status" ]; then
            failed=$((failed + 1))
            [ "$failed" -gt 5 ] || names+=" $description ($(cat "$GL_DIR/$description.status"))"
            [ "$failed" -ne 6 ] || names+=" …"
        else
            untried=$((untried + 1))
        fi
    done
    say "$rows rows: $((rows - tried)) complete before, $((tried - failed - untried)) run, $failed failed${names:+:$names}"
    rm -rf "$GL_DIR/.run"
    [ "$untried" -eq 0 ] || { say "$untried rows were not tried; call again to go on"; return 1; }
}
