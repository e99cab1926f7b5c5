# The posterior as a table for reading, and which run fitted best.
BEGIN { FS = "\t"; row = "%-12s %12s %12s %12s %12s %12s\n" }
{ value[$1] = $2 }
# A parameter of an effect that is off does not vary, and has no shrinkage.
/^shrinkage\(/ { parameters[++count] = substr($1, 11, length($1) - 11) }
END {
    printf row, "parameter", "mean", "sd", "5 %", "95 %", "best run"
    for (j = 1; j <= count; j++) {
        name = parameters[j]
        printf row, name, number("mean"), number("sd"), number("q05"), number("q95"), number("best")
    }
    printf "\nbest run %s, error %.3g of the range; the posterior rests on %.3g of %d runs, %d failed\n", \
        value["best_sample"], value["best_error"], value["ess_runs"], value["runs"], value["failed"]
}
function number(quantity) { return sprintf("%.5g", value[quantity "(" name ")"]) }
