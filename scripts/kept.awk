# How many runs are to keep weight when the next samples are drawn: a share of the runs of one iteration,
# but enough to see the shape of the posterior in, 2 d + 4 where d parameters vary. Reads a samples table. With
# -v count=1 it prints d instead.
FNR == 1 { for (j = 1; j <= NF; j++) if ($j == "description" || $j == "key") skip[j]; next }
{
    runs++
    for (j = 1; j <= NF; j++) {
        if (runs == 1) first[j] = $j
        else if (!(j in skip) && !(j in varies) && $j != first[j]) { varies[j]; parameters++ }
    }
}
END {
    if (count) { print parameters + 0; exit }
    least = 2 * parameters + 4
    kept = share * runs
    print (kept > least ? kept : least)
}
