#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export CASE=$ROOT/examples/collision

# No newline at the end, and a number whose last digit Yade would lose with it.
with_table() { printf 'description,key,E_m,nu\nr0,0,9.3,0.2\nr1,01,8,0\nr2,2,9,0.25' >samples.txt; }

# A script that fails where a is 3 and hangs where it is 4.
with_script() {
    cat >model.py <<'END'
import time
import gl_yade
p = gl_yade.parameters(a=0)
if p.a == 3:
    raise ValueError('three')
if p.a == 4:
    time.sleep(60)
gl_yade.write_run({'u': [0, 1], 'f': [p.a, 2 * p.a]})
END
    printf 'description\tkey\ta\nr0\t0\t1\nr1\t1\t3\nr2\t2\t4\n' >samples.txt
    unset CASE
}

two_spheres_follow_hertz() {
    needs yade yade
    with_table
    ends_with 0 run-local samples.txt collision.py runs
    says '3 run, 0 failed'
    awk 'FNR == NR { if (FNR == 2) e = 10^$1 / (2 * (1 - $2^2)); next }
         FNR > 2 { f = 4 / 3 * e * sqrt(5e-4) * $1^1.5; if (($2 / f - 1)^2 > 1e-22) exit 1 }
         END { if (FNR != 82) exit 1 }' runs/r2_param.txt runs/r2_sim.txt
    same "$(cat runs/r2_param.txt)" $'E_m\tnu\n9.0\t0.25'
}

yade_batch_gives_the_same_bytes() {
    needs yade yade yade-batch
    with_table
    ends_with 0 run-local samples.txt collision.py 'a folder'
    ends_with 0 run-yade-batch samples.txt collision.py 'another folder'
    for file in 'a folder'/*.txt; do cmp "$file" "another folder/${file#a folder/}"; done
    same "$(find 'another folder' -name '*.txt' | wc -l)" 6
    absent 'another folder/.run'
}

yade_batch_is_given_what_is_missing() {
    needs yade yade yade-batch
    with_table
    ends_with 0 run-yade-batch samples.txt collision.py runs
    rm runs/r1_sim.txt
    ends_with 0 run-yade-batch samples.txt collision.py runs
    says '2 complete before, 1 run, 0 failed'
    same "$(grep -c 'started on' runs/yade-batch.log)" 1
}

exit_codes_and_time_limits_are_kept_with_either_engine() {
    needs yade yade yade-batch
    with_script
    for engine in run-local run-yade-batch; do
        RUN_TIMEOUT=15 ends_with 0 "$engine" samples.txt model.py "$engine"
        same "$(cat "$engine"/r{0,1,2}.status)" $'0\n1\n124 TIMEOUT'
        grep -q 'ValueError: three' "$engine/r1.log"
        absent "$engine"/r1_sim.txt "$engine"/r2_sim.txt
    done
}

a_misspelt_parameter_fails_the_run() {
    needs yade yade
    with_script
    printf 'description\tkey\tA\nr0\t0\t1\n' >samples.txt
    ends_with 0 run-local samples.txt model.py runs
    grep -q "has no default value" runs/r0.log
    same "$(cat runs/r0.status)" 1
}

adhesion_and_damping_change_the_contact_as_they_should() {
    needs yade yade
    CASE=$ROOT/examples/collision-effects
    printf 'description key gamma beta\nbase 0 0 0\nadhesion 1 10 0\ndamping 2 0 0.2\n' >samples.txt
    ends_with 0 run-local samples.txt collision.py runs
    says '3 run, 0 failed'
    paste runs/{base,adhesion,damping}_sim.txt | awk '
        # DMT: the force is less by 4 pi R* gamma, at any speed, as long as the spheres touch.
        NR > 2 && $1 > 0 { if (($2 - $5 - 0.0628318530718)^2 > 1e-20) exit 1 }
        # Damping resists: fast loading takes more force and fast unloading gives less.
        NR > 2 && NR < 125 && $1 > 0 {
            fast = NR > 46
            if (!fast && ($8 - $2)^2 > 1e-8) exit 1
            if (fast && $1 > last && $8 <= $2) exit 1
            if (fast && $1 < last && $8 >= $2) exit 1
            last = $1
        }'
}

a_triaxial_test_is_the_same_twice_and_reaches_its_density() {
    needs yade yade
    CASE=$ROOT/examples/triaxial
    printf 'description key eta n0 seed\na 0 0.2 0.4 5\nb 1 0.2 0.4 5\n' >samples.txt
    ends_with 0 run-local samples.txt triaxial.py runs
    cmp runs/a_sim.txt runs/b_sim.txt
    awk 'NR == 2 { if ($1 != 0 || $2 < 0.64 || $2 > 0.67 || $3 < 0.98 || $3 > 1.02) exit 1 }
         END { if ($1 < 0.1 || $3 < 2) exit 1 }' runs/a_sim.txt
}

lammps_agrees_with_hertz() {
    needs lammps lmp
    export OMPI_MCA_ess_singleton_isolated=1 OMPI_MCA_orte_create_session_dirs=0
    with_table
    ends_with 0 run-local samples.txt 'lmp -in {case}/lammps.in -log none -screen none -var E_m {E_m} -var nu {nu} -var name {description}' runs
    says '3 run, 0 failed'
    ends_with 0 run-local samples.txt collision.py yade
    paste runs/r0_sim.txt yade/r0_sim.txt | awk 'NR > 2 && ($1 - $3)^2 > 1e-26 || NR > 3 && ($2 / $4 - 1)^2 > 1e-12 { exit 1 }'
}

# A specimen of few grains is no specimen: what is named does not matter.
a_riddle_by_lammps_is_diagnosed_with_runs_that_are_kept() {
    needs lammps lmp
    export GRAINS=60 SPECIMENS=1
    riddle() { "$ROOT/examples/triaxial-effects/lammps/blind" 2 riddle 2>err || same $? 1; }
    riddle
    says 'runs are not made but taken from'
    same "$(wc -l <riddle/outcome.txt)" 2
    mv riddle/attribution.txt before
    riddle
    cmp riddle/attribution.txt before
}

facts "$@"
