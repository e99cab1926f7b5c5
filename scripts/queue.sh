# shellcheck shell=bash
# What submit, status and cancel share: which scheduler a calibration is in. Sourced after lib.sh.
#
# Once it was submitted, OUT holds
#     scheduler   slurm or pbs          control.log  words of the last controlling job
#     control.sh  the controlling job   control.id   its id, with PBS

# jobs_noted OUT: the lines "NAME ID" of the arrays that its calibration has in the queue, or had last.
jobs_noted() { cat "$1"/iter*/runs/.run/jobs 2>/dev/null || true; }

# use_scheduler OUT: the functions of slurm.sh or of pbs.sh.
use_scheduler() {
    local name
    name=$(cat "$1/scheduler")
    case $name in
        slurm | pbs)
            # shellcheck source=/dev/null
            . "$HERE/$name.sh"
            ;;
        *) die "$1/scheduler: \"$name\": there are slurm and pbs" ;;
    esac
}
