#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PYTHONPATH=$ROOT/scripts PYTHONDONTWRITEBYTECODE=1

a_run_is_written_without_yade() {
    needs python3 python3
    python3 -c 'import gl_yade; gl_yade.write_run({"u": [0, 1e-7], "f": [0.1, 1e300]}, {"a": 1/3, "b": 2}, "r")'
    same "$(cat r_sim.txt)" $'u\tf\n0.0\t0.1\n1e-07\t1e+300'
    same "$(cat r_param.txt)" $'a\tb\n0.3333333333333333\t2.0'
    same "$(ls)" $'r_param.txt\nr_sim.txt'
}

columns_of_different_lengths_are_refused_and_leave_nothing() {
    needs python3 python3
    ends_with 1 python3 -c 'import gl_yade; gl_yade.write_table("r_sim.txt", {"u": [0, 1], "f": [0]})'
    says 'r_sim.txt: columns of different lengths'
    ends_with 1 python3 -c 'import gl_yade; gl_yade.write_table("r_sim.txt", {"u": [0, 1], "f": [0, "x"]})'
    ends_with 1 python3 -c 'import gl_yade; gl_yade.write_table("r_sim.txt", {"u v": [0]})'
    ends_with 1 python3 -c 'import gl_yade; gl_yade.write_table("r_sim.txt", {})'
    same "$(ls)" $'err\nout'
}

a_finished_file_is_not_touched_by_a_failing_write() {
    needs python3 python3
    echo old >r_sim.txt
    ends_with 1 python3 -c 'import gl_yade, os; os.fsync = None; gl_yade.write_table("r_sim.txt", {"u": [0]})'
    same "$(cat r_sim.txt)" old
    same "$(ls)" $'err\nout\nr_sim.txt'
}

facts "$@"
