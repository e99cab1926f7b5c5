# shellcheck shell=bash
# What both reports say, as tables of tabs and as sentences. Sourced, with CASE, ENGINE, OUT and here set.

# Where no tools are in PATH: those that were built or installed with this script.
# shellcheck disable=SC2154  # here is set by the script that sources this
PATH=$PATH:$here/../target/release:$here/../../../bin

# setting KEY: the value that the calibration had, of the environment or of case.env.
setting() {
    local table
    for table in "$CASE/case.env" "$OUT/settings.env" "$OUT/base/settings.env"; do
        [ ! -e "$table" ] || sed -n "s/^$1=//p" "$table"
    done | tail -n 1
}

# measured NAMES: what the measurement calls these columns.
measured() { tr ',' '\n' <<<"$1" | sed 's/=.*//' | paste -sd ,; }

# value SUMMARY QUANTITY
value() { awk -F '\t' -v quantity="$2" '$1 == quantity { print $2 }' "$1"; }

# rows TABLE: how many it has.
rows() { awk 'NF && !/^[ \t]*#/ { count++ } END { print count ? count - 1 : 0 }' "$1"; }

# iterations DIR: the folders of the iterations that are finished, in order.
iterations() {
    local i=0
    while [ -e "$1/iter$i/stop.code" ]; do
        printf '%s\n' "$1/iter$i"
        i=$((i + 1))
    done
}

# sentences LOG: without the names of the tools that said them, each with a capital and an end.
sentences() {
    awk '{ sub(/^[a-z-]+: /, ""); sub(/[.]$/, ""); if ($0 != "") print toupper(substr($0, 1, 1)) substr($0, 2) "." }' "$1"
}

# varied SUMMARY: the parameters that a calibration varied. The others, effects that are off, stand still.
varied() { sed -n 's/^shrinkage(\(.*\))\t.*/\1/p' "$1"; }

# still SUMMARY: the others, separated by tabs.
still() {
    awk '
        { name = $1; sub(/^[a-z0-9]+[(]/, "", name); sub(/[)]$/, "", name) }
        /^mean[(]/ { order[++count] = name }
        /^shrinkage[(]/ { varied[name] = 1 }
        END { for (j = 1; j <= count; j++) if (!(order[j] in varied)) printf "%s\t", order[j] }
    ' "$1"
}

# posterior_table SUMMARY: what is known of each parameter that was varied, and what the data could not tell.
posterior_table() {
    awk -F '\t' '
        { value[$1] = $2 }
        /^shrinkage[(]/ { parameters[++count] = substr($1, 11, length($1) - 11) }
        function of(quantity) { return value[quantity "(" name ")"] }
        END {
            print "parameter\tmean\tsd\t5 %\t95 %\tbest run\tof the prior sd\tthe data"
            for (j = 1; j <= count; j++) {
                name = parameters[j]
                left = sqrt(of("shrinkage") < 1 ? 1 - of("shrinkage") : 0)
                told = left > 0.7 ? "hardly tell it" : left > 0.3 ? "tell it in part" : "tell it"
                if (of("lean")) told = told "; it leans on its " (of("lean") > 0 ? "upper" : "lower") " bound: the truth may lie outside"
                printf "%s\t%s\t%s\t%s\t%s\t%s\t%.3g %%\t%s\n", name, of("mean"), of("sd"), of("q05"), of("q95"), of("best"), 100 * left, told
            }
        }
    ' "$1"
}

# standing DIR: how far a calibration has come, in sentences.
standing() {
    local last
    last=$(iterations "$1" | tail -n 1)
    awk -F '\t' -v iterations="$(iterations "$1" | wc -l)" -v go_on="$(cat "$last/stop.code")" '
        FNR == 1 { table++ }
        table == 1 { tempered[$1] = $2 }
        table == 2 { posterior[$1] = $2 }
        table == 2 && /^shrinkage[(]/ { parameters++ }
        END {
            printf "%d iterations made %d runs, of which %d failed.\n", iterations, posterior["runs"], posterior["failed"]
            if (go_on) print "No criterion was met; the number of iterations ended it."
            ratio = tempered["sigma"] / tempered["sigma_noise"]
            if (ratio > 1.0000001) printf "Sigma is still %.3g times that of the noise: more iterations would sharpen the posterior.\n", ratio
            else print "Sigma has come down to that of the noise: this is the posterior itself, not a tempered one."
            printf "The best run, %s, misses the measurement by %.2g %% of its range.\n", posterior["best_sample"], 100 * posterior["best_error"]
            few = posterior["ess_runs"] < 2 * parameters + 4
            printf "The posterior rests on %.3g runs%s.\n", posterior["ess_runs"], few ? ", which is few: take the means as rough; the intervals are widened for it" : ""
        }
    ' "$last/summary.txt" "$1/posterior.txt"
    sentences "$last/stop.log" | grep -v 'posterior rests on' || true
}

# iterations_table DIR
iterations_table() {
    local folder files=()
    while read -r folder; do files+=("$folder/summary.txt"); done < <(iterations "$1")
    awk -F '\t' '
        function row() {
            printf "%d\t%s\t%s\t%s\t%s\t%s\t%s\t%s\n", iteration++, value["runs"], value["failed"], value["sigma"], value["sigma_noise"], value["ess_runs"], value["ensemble_error"], value["best_error"]
        }
        BEGIN { print "iteration\truns so far\tfailed\tsigma\tnoise\teffective runs\tmean error\tbest error" }
        FNR == 1 && NR > 1 { row() }
        { value[$1] = $2 }
        END { row() }
    ' "${files[@]}"
}

# failed_runs FOLDER...: the runs that were left out, and why.
failed_runs() {
    local folder
    printf 'run\tstatus\tdetail\n'
    for folder; do
        [ ! -e "$folder/status.txt" ] || awk -F '\t' 'FNR > 1 && $2 != "ok" { print $1 "\t" $2 "\t" $3 }' "$folder/status.txt"
    done
}

# versions: of the tools, and of Yade where it made the runs.
versions() {
    local tool
    for tool in gl-sample gl-collect gl-filter gl-gmm-resample gl-gap-locate gl-gap-attribute gl-gap-shrink gl-plot; do
        command -v "$tool" >/dev/null && "$tool" --version
    done | awk '{ if (!($2 in tools)) order[++count] = $2; tools[$2] = tools[$2] (tools[$2] == "" ? "" : ", ") $1 }
        END { for (j = 1; j <= count; j++) print order[j] ": " tools[order[j]] }'
    case $ENGINE:$(setting MODEL) in
        embedded:*) ;;
        *.py) ! command -v yade >/dev/null || yade --version 2>/dev/null | sed -n 's/^Yade version: *\([^ ]*\).*/\1: Yade/p' ;;
    esac
}
