#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"

# A copy of the project, in which what is built is taken as it is.
with_project() {
    mkdir bin docs
    printf '#!/bin/sh\n' >bin/cargo
    chmod +x bin/cargo
    cp -r "$ROOT"/{Makefile,README.md,scripts,examples,tools} .
    mkdir -p target
    ln -s "${GL_BIN:-$ROOT/target/release}" target/release
    export PATH=$PWD/bin:$PWD/target/release:$PWD/scripts:$PATH
}

# The commands of a page in such a copy: its blocks that are marked ```sh run, or ```sh run KIND where a kind is
# asked for, one after another, each from the top. What they say stays in block01.out, …
with_commands_of() {
    local blocks block
    with_project
    awk -v to="block" -v kind="${2:+ $2}" '
        /^ *```/ { if (on) on = 0; else if ($0 ~ "^ *```sh run" kind "$") { on = 1; file = sprintf("%s%02d.sh", to, ++count) } else if (!skip) skip = 1; else skip = 0; next }
        on { print >file }
    ' "$ROOT/$1"
    blocks=(block*.sh)
    [ -e "${blocks[0]}" ] || { echo "no command in $1"; return 1; }
    for block in "${blocks[@]}"; do
        bash -euo pipefail "$block" >"${block%.sh}.out" 2>&1 || { cat "$block" "${block%.sh}.out"; return 1; }
    done
}

commands_of_the_readme_run() { with_commands_of README.md; }
what_the_readme_shows_of_its_first_command_is_what_it_prints() {
    with_project
    awk '/^```console$/ { on = 1; next } /^```$/ { on = 0 } on' README.md >shown
    # shellcheck disable=SC2016  # a prompt
    same "$(head -n 1 shown)" '$ gl-calibrate examples/collision'
    gl-calibrate examples/collision >printed 2>&1
    diff <(tail -n +2 shown) printed
}
the_demo_ends_with_a_verdict_and_a_picture() {
    with_project
    make demo >out.txt 2>&1
    grep -q 'gl-check-stop: stop, by settled' out.txt
    grep -q 'fit is drawn in out/demo-embedded/fit.png' out.txt
    [ -s out/demo-embedded/fit.png ]
    make report OUT=out/demo-embedded >out.txt 2>&1
    [ -s out/demo-embedded/report.html ]
}
commands_of_the_tutorial_run() {
    needs python3 python3
    with_commands_of docs/tutorial.md
    [ -s out/collision/report.html ] && [ -s out/contact-effects-diagnosis/report.html ]
    # What the page says of its own case is so, and that case is the example.
    local out=out/my-oscillator-diagnosis
    [ -s $out/report.html ]
    grep -q '^noise-too-small' $out/base/iter*/posterior-verdict.txt
    same "$(cat $out/winner.txt)" friction
    grep -q '^cause.friction' $out/attribution-verdict.txt
    grep -q '^closes' $out/shrink-verdict.txt
    same "$(tr -s ' ' '\t' <my-oscillator/params.txt)" "$(cat examples/oscillator/params.txt)"
    same "$(sed 's/ *#.*//' my-oscillator/case.toml)" "$(cat examples/oscillator/case.toml)"
}
commands_on_tables_run() { with_commands_of docs/tables.md; }
commands_on_calibration_run() { with_commands_of docs/calibration.md; }
commands_on_stop_criteria_run() { with_commands_of docs/stop-criteria.md; }
commands_on_diagnosis_run() { with_commands_of docs/diagnosis.md; }
commands_on_accuracy_run() { with_commands_of docs/diagnosis-accuracy.md; }
commands_on_yade_scripts_run() { needs python3 python3; with_commands_of docs/yade-script.md; }
commands_for_yade_run() { needs yade yade yade-batch; with_commands_of docs/yade-script.md yade; }
commands_on_other_simulators_run() { with_commands_of docs/other-simulators.md; }
commands_for_lammps_run() {
    needs lammps lmp
    with_commands_of docs/other-simulators.md lammps
    same "$(grep -c _sim.txt block01.out)" 4
}
commands_on_clusters_run() {
    with_slurm
    with_commands_of docs/clusters.md slurm
    grep -q 'controlling job' block01.out
    same "$(find runs -name '*_sim.txt' | wc -l)" 8
}
commands_for_pbs_run() {
    mkdir pbs
    export FAKE_PBS=$PWD/pbs PATH=$ROOT/tests/scripts/fake-pbs:$PATH
    with_commands_of docs/clusters.md pbs
    same "$(find runs -name '*_sim.txt' | wc -l)" 4
}
commands_on_pictures_run() { with_commands_of docs/pictures-compared.md; }
commands_on_grainlearning_run() { needs python3 python3; with_commands_of docs/coming-from-grainlearning.md; }

# Every address in the pages of a site leads to a file in it, and to a heading of it where one is named; nothing comes
# from elsewhere.
with_links_of() {
    python3 - "$1" <<'END'
import pathlib, sys, urllib.parse
from html.parser import HTMLParser


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.names = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        assert tag not in ("script", "link", "iframe"), tag
        for key, value in attributes:
            if key in ("href", "src"):
                self.links.append((key, value))
            if key == "id":
                self.names.add(value)


root = pathlib.Path(sys.argv[1]).resolve()
pages = {path: Page(path.read_text()) for path in root.rglob("*.html")}
count = 0
for path, page in pages.items():
    for key, link in page.links:
        if key == "href" and link.startswith("http"):
            continue
        file, _, name = urllib.parse.unquote(link).partition("#")
        to = (path.parent / file).resolve() if file else path
        assert to.is_file() and root in to.parents, (path, link)
        assert not name or name in pages[to].names, (path, link)
        count += 1
print(len(pages), "pages,", count, "links")
END
}

# A site of all pages, and none where a link leads nowhere.
pages_become_a_site_and_a_dead_link_is_said() {
    needs python3 python3
    local site=${GL_BIN:-$ROOT/target/release}/site page
    "$site" --root "$ROOT" made
    with_links_of made
    for page in "$ROOT"/docs/*.md "$ROOT"/examples/*/README.md; do
        page=${page#"$ROOT"/}
        page=${page/README.md/index.md}
        [ -s "made/${page%.md}.html" ] || { echo "no $page"; return 1; }
    done
    # The tutorial comes first.
    same "$(grep -o '<a href="[^"]*">' made/index.html | sed -n 1p)" '<a href="docs/tutorial.html">'
    mkdir copy
    cp -r "$ROOT"/{README.md,CONTRIBUTING.md,CHANGELOG.md,docs,examples} copy
    echo '[nowhere](tables.md#no-such-heading)' >>copy/docs/tutorial.md
    ends_with 2 "$site" --root copy other
    says 'docs/tutorial.md: tables.md#no-such-heading'
    [ ! -e other ]
}

names_of_yade_in_the_pages_are_yades() {
    needs yade yade
    # shellcheck disable=SC2016  # backquotes are Markdown's
    # The words between backquotes in the table for Yade of the page on effects: classes, and what they have.
    awk '/^In Yade/ { on = 1 } /^In LAMMPS/ { on = 0 } on && /^\|/' "$ROOT/docs/candidate-effects.md" | grep -o '`[^`]*`' |
        tr -d '`' | sed 's/=.*//; s/.*\.//' | sort -u >names
    [ "$(wc -l <names)" -ge 20 ]
    cat >look.py <<'END'
names = open('names').read().split()
classes = [globals()[name] for name in names if isinstance(globals().get(name), type)]
classes += [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys, Ip2_FrictMat_FrictMat_MindlinPhys, NewtonIntegrator]
known = {one.__name__ for one in classes}.union(*(dir(one()) for one in classes))
open('lacking', 'w').write(' '.join(name for name in names if name not in known) + '\n')
END
    yade -n -x look.py >log 2>&1
    same "$(cat lacking)" ''
}

facts "$@"
