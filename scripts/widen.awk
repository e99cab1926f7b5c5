# The box of a design made wider where a hypothesis leans on it, as far as the table of parameters allows.
#     awk -f widen.awk params.txt box.txt posterior.txt
# posterior.txt is what gl-gap-attribute --posterior-out wrote. Without a reason to widen it, the box as it is.
BEGIN { OFS = "\t" }
/^[ \t]*$/ || (/^[ \t]*#/ && columns[FILENAME]) { next }
function place(value) { return scale == "log" ? log(value) : value }
function bound(value) { return scale == "log" ? exp(value) : value }
!columns[FILENAME]++ {
    table++
    sub(/^[ \t]*#[ \t]*/, "")
    for (j = 1; j <= NF; j++) at[table, $j] = j
    if (table == 2) row[++rows] = $0
    next
}
table == 1 { lower[$at[1, "name"]] = $at[1, "lower"]; upper[$at[1, "name"]] = $at[1, "upper"] }
table == 2 { row[++rows] = $0 }
table == 3 && $at[3, "lean"] < 0 { leans_low[$at[3, "parameter"]] = 1 }
table == 3 && $at[3, "lean"] > 0 { leans_high[$at[3, "parameter"]] = 1 }
END {
    for (j = 1; j <= rows; j++) {
        $0 = row[j]
        if (j > 1) {
            name = $at[2, "name"]
            scale = (2, "scale") in at ? $at[2, "scale"] : "linear"
            low = place($at[2, "lower"]); high = place($at[2, "upper"])
            width = high - low
            if (name in leans_low && low > place(lower[name])) {
                low -= width
                $at[2, "lower"] = low > place(lower[name]) ? sprintf("%.6g", bound(low)) : lower[name]
            }
            if (name in leans_high && high < place(upper[name])) {
                high += width
                $at[2, "upper"] = high < place(upper[name]) ? sprintf("%.6g", bound(high)) : upper[name]
            }
        }
        $1 = $1
        print
    }
}
