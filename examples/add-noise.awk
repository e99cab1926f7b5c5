# Add normal noise to columns of a table; the same seed gives the same noise.
#     awk -f add-noise.awk -v seed=1 -v sd='y=0.2 slope=0.05' clean.txt >obs.txt
BEGIN {
    FS = OFS = "\t"
    state = 48271 * seed % 2147483647
    for (i = split(sd, given, /[= ]/); i > 1; i -= 2) sd_of[given[i - 1]] = given[i]
}

# Park & Miller's generator: exact in floating point, and so the same in every awk.
function uniform() {
    state = 16807 * state % 2147483647
    return state / 2147483647
}

function normal() { return sqrt(-2 * log(uniform())) * cos(6.283185307179586 * uniform()) }

NR == 1 {
    for (j = 1; j <= NF; j++) name[j] = $j
    print
    next
}

{
    for (j = 1; j <= NF; j++) if (name[j] in sd_of) $j = sprintf("%.6g", $j + sd_of[name[j]] * normal())
    print
}
