#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH

# A folder as GrainLearning 2 leaves it: y = a x + b at three samples in text.
with_text_folder() {
    mkdir -p old/iter0
    echo '!OMP_NUM_THREADS description key a b ' >old/iter0/line_Iter0_Samples.txt
    local j=0 a
    for a in 0.1 0.2 0.3; do
        echo " 4 line_Iter0_Sample$j         $j     ${a}000000000e+00     5.0000000000e+00 " >>old/iter0/line_Iter0_Samples.txt
        printf '# a b\n%s 5.0\n' "$a" >"old/iter0/line_Iter0_Sample${j}_param.txt"
        awk -v a="$a" 'BEGIN { print "# x y"; for (x = 0; x < 3; x++) print x, a * x + 5 }' >"old/iter0/line_Iter0_Sample${j}_sim.txt"
        j=$((j + 1))
    done
    printf 'x y\n0 5\n1 5.2\n2 5.4\n' >obs.txt
}

with_best() {
    gl-collect -s new/iter0/samples.txt -b obs.txt -c x -v y new/iter0/runs -o ensemble.txt 2>err
    gl-likelihood -b obs.txt -c x -v y --noise y=0.1 ensemble.txt |
        gl-filter -s new/iter0/samples.txt --sigma noise --summary summary.txt >weights.txt 2>>err
    awk '$1 == "best(a)" { print $2 }' summary.txt
}

text_runs_can_be_collected_and_weighed() {
    needs python3 python3
    with_text_folder
    ends_with 0 from-grainlearning old new
    says 'iter0: 3 samples, 3 runs'
    same "$(head -2 new/iter0/samples.txt)" $'description\tkey\ta\tb\nline_Iter0_Sample0\t0\t0.1000000000e+00\t5.0000000000e+00'
    same "$(cat new/iter0/runs/line_Iter0_Sample1_sim.txt)" $'x\ty\n0\t5\n1\t5.2\n2\t5.4'
    same "$(cat new/iter0/runs/line_Iter0_Sample1_param.txt)" $'a\tb\n0.2\t5.0'
    same "$(with_best)" 0.2
}

npy_runs_give_the_same() {
    needs python3 python3
    python3 -c 'import numpy' 2>/dev/null || needs numpy numpy-for-python3
    with_text_folder
    python3 - <<'END'
import numpy

for j, a in enumerate((0.1, 0.2, 0.3)):
    x = numpy.arange(3.0)
    numpy.save('old/iter0/line_Iter0_Sample%d.npy' % j, {'x': x, 'y': a * x + 5, 'a': a, 'b': numpy.float64(5)})
END
    rm old/iter0/*_sim.txt old/iter0/*_param.txt
    ends_with 0 from-grainlearning old new
    says 'iter0: 3 samples, 3 runs'
    same "$(with_best)" 0.2
    # Without the table as well.
    rm -r new old/iter0/line_Iter0_Samples.txt
    ends_with 0 from-grainlearning old new
    same "$(with_best)" 0.2
}

a_pickle_that_would_run_something_is_left_out() {
    needs python3 python3
    python3 -c 'import numpy' 2>/dev/null || needs numpy numpy-for-python3
    with_text_folder
    rm old/iter0/line_Iter0_Sample2_*
    python3 - <<'END'
import os

import numpy


class Trap:
    def __reduce__(self):
        return os.system, ('touch hit',)


numpy.save('old/iter0/line_Iter0_Sample2.npy', {'x': Trap()})
END
    ends_with 0 from-grainlearning old new
    says 'which is no data'
    says 'iter0: 3 samples, 2 runs'
    absent hit
}

a_run_that_is_cut_off_is_left_out() {
    needs python3 python3
    with_text_folder
    printf '# x y\n0 5\n1\n' >old/iter0/line_Iter0_Sample2_sim.txt
    ends_with 0 from-grainlearning old new
    says 'left out: old/iter0/line_Iter0_Sample2_sim.txt: 1 fields where the header names 2'
    says 'iter0: 3 samples, 2 runs'
}

a_folder_without_iterations_is_refused() {
    needs python3 python3
    mkdir old
    ends_with 2 from-grainlearning old new
    says 'old: no folder iter0'
    absent new
}

facts "$@"
