# The effects of the simulator in the most probable hypothesis, separated by commas; nothing for none,
# for unexplained and for what the measurement does. Reads the parameters, then the attribution.
FNR == 1 { table++; for (j = 1; j <= NF; j++) column[table, $j] = j; next }
table == 1 { known[$column[1, "effect"]] = 1; next }
FNR == 2 {
    count = split($column[2, "hypothesis"], effects, "+")
    for (k = 1; k <= count; k++) if (effects[k] in known) list = list (list == "" ? "" : ",") effects[k]
    print list
}
