# One line of an iteration, from the summary that it was resampled by and the posterior of all runs.
BEGIN { FS = "\t" }
FNR == 1 { table++; next }
table == 1 { tempered[$1] = $2; next }
{ posterior[$1] = $2 }
# A parameter of an effect that is off does not vary, and has no shrinkage.
/^shrinkage\(/ { parameters[++count] = substr($1, 11, length($1) - 11) }
END {
    printf "iteration %d: %d runs, %d failed; sigma %.3g (noise %.3g), ess %.2g of the runs; error %.3g, best %.3g;", \
        iteration, tempered["runs"], tempered["failed"], tempered["sigma"], tempered["sigma_noise"], tempered["ess"], \
        tempered["ensemble_error"], tempered["best_error"]
    for (j = 1; j <= count; j++) {
        name = parameters[j]
        printf " %s %.5g ± %.2g%s", name, posterior["mean(" name ")"], posterior["sd(" name ")"], j < count ? "," : "\n"
    }
}
