# Draw a truth with one effect in it: a samples table of one row.
#     awk -f draw-truth.awk -v seed=1 params.txt
# Base parameters and the effect's strength come from the middle half of their ranges.
function uniform() {
    state = 16807 * state % 2147483647
    return state / 2147483647
}

BEGIN {
    state = 48271 * (seed + 1) % 2147483647
    # Neighbouring seeds begin alike, so that each skips another number of draws.
    uniform()
    for (i = int(1000 * uniform()); i >= 0; i--) uniform()
}

NR == 1 {
    for (j = 1; j <= NF; j++) place[$j] = j
    next
}

{
    name[++n] = $place["name"]
    lower[n] = $place["lower"]
    upper[n] = $place["upper"]
    off[n] = $place["off"]
    effect[n] = $place["effect"]
    if (effect[n] != "-") candidate[++candidates] = n
}

END {
    chosen = candidate[1 + int(candidates * uniform())]
    header = "description\tkey"
    row = "truth\t0"
    for (i = 1; i <= n; i++) {
        value = lower[i] + (0.25 + 0.5 * uniform()) * (upper[i] - lower[i])
        header = header "\t" name[i]
        row = row "\t" (effect[i] == "-" || i == chosen ? value : off[i])
    }
    print header "\n" row
}
