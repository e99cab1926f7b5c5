# The table of parameters for a design: base parameters between the runs that fit about as well as the best.
#     awk -f narrow.awk params.txt posterior-weights.txt
# A prior that is wide beside what the measurement allows makes curves of which an emulator knows the
# details only roughly. Kept is what lies between runs whose root-mean-square misfit is up to three times
# the smallest, half as wide again, and at least a quarter of the prior's width: an effect moves the base
# parameters that fit.
BEGIN { OFS = "\t"; REACH = 3; WIDER = 1.5; SHARE = 0.25 }
/^[ \t]*$/ || (/^[ \t]*#/ && columns[FILENAME]) { next }
function place(j, value) { return scale[j] == "log" ? log(value) : value }
function bound(j, value) { return scale[j] == "log" ? exp(value) : value }
!columns[FILENAME]++ { table++; sub(/^[ \t]*#[ \t]*/, ""); delete at; for (j = 1; j <= NF; j++) at[$j] = j }
table == 1 {
    row[++rows] = $0
    if (rows == 1) { for (name in at) of[name] = at[name]; next }
    scale[rows] = "scale" in of ? $of["scale"] : "linear"
    name_of[rows] = $of["name"]
    is_base[rows] = !("effect" in of) || $of["effect"] == "-"
    next
}
$1 == "sample" { next }
{
    runs++
    misfit[runs] = $at["misfit"]
    if (runs == 1 || misfit[runs] < least) { least = misfit[runs]; best = runs }
    for (j = 2; j <= rows; j++) value[runs, j] = place(j, $at[name_of[j]])
}
END {
    for (j = 1; j <= rows; j++) {
        $0 = row[j]
        if (j > 1 && is_base[j] && runs) {
            lower = place(j, $of["lower"]); upper = place(j, $of["upper"])
            low = high = value[best, j]
            for (i = 1; i <= runs; i++) if (misfit[i] <= REACH * REACH * least) {
                if (value[i, j] < low) low = value[i, j]
                if (value[i, j] > high) high = value[i, j]
            }
            width = WIDER * (high - low)
            if (width < SHARE * (upper - lower)) width = SHARE * (upper - lower)
            lacking = width - (high - low)
            low -= lacking / 2
            high += lacking / 2
            if (low > lower) $of["lower"] = sprintf("%.6g", bound(j, low))
            if (high < upper) $of["upper"] = sprintf("%.6g", bound(j, high))
        }
        $1 = $1
        print
    }
}
