#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH
export MAKE=make

# A finished calibration of the contact, in made.
with_calibration() {
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^NUM=.*/NUM=20/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    calibrate case embedded made >log 2>&1
}

# Every section, every picture at both widths, nothing from elsewhere, every tag closed.
with_everything_in() {
    local section
    for section in verdict calibrated stands posterior gap cause closed failed again; do
        grep -q "<section id=\"$section\"" "$1" || { echo "no section $section"; return 1; }
    done
    if grep -nE 'https?:|<(script|link|img|iframe)|url\(' "$1"; then return 1; fi
    same "$(grep -c '<svg class="mm170"' "$1")" "$2"
    same "$(grep -c '<svg class="mm80"' "$1")" "$2"
    same "$(grep -c '<figcaption>' "$1")" "$2"
    python3 - "$1" <<'END'
import sys
from html.parser import HTMLParser

EMPTY = {"meta", "br", "path", "rect", "line", "circle"}


class Nesting(HTMLParser):
    open = []

    def handle_starttag(self, tag, attributes):
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        if tag not in EMPTY:
            assert self.open and self.open.pop() == tag, (tag, self.getpos())


page = Nesting()
page.feed(open(sys.argv[1]).read())
assert not page.open, page.open
END
}

a_calibration_becomes_one_file_with_its_pictures() {
    needs python3 python3
    with_calibration
    report-html case embedded made >log
    with_everything_in made/report.html 6
    grep -q '2 iterations made 40 runs, of which 0 failed' made/report.html
    grep -q 'make calibrate CASE=case ENGINE=embedded OUT=made ITERATIONS=2' made/report.html
    grep -q 'off in the calibration: w tau plastic' made/report.html
    # Effects that are off are no parameters of the posterior.
    same "$(sed -n '/id="posterior"/,/<figure>/s/^<tr><td>\([^<]*\).*/\1/p' made/report.html | paste -sd ' ')" 'E_m nu mu'
}

# The report in a browser: what the frames of browser.html say, and nothing on its console.
with_browser() {
    local scheme=$1 number
    number=$([ "$scheme" = dark ] && echo 0 || echo 1)
    cp "$ROOT/tests/scripts/browser.html" .
    { sed '/<\/body>/,$d' made/report.html; echo '<script>'; cat "$ROOT/tests/scripts/browser.js"; echo '</script>'; } >report.html
    # Of its own complaints, such as of a bus that is missing, only those of the page count.
    timeout 120 chromium --headless=new --no-sandbox --disable-gpu --user-data-dir="$PWD/profile" \
        --blink-settings=preferredColorScheme="$number" --virtual-time-budget=5000 --window-size=1700,900 \
        --enable-logging=stderr --dump-dom "file://$PWD/browser.html" >dom.html 2>log
    if grep CONSOLE log; then return 1; fi
    grep -o '<p>width [^<]*' dom.html | sort | sed 's/<p>//'
}

a_browser_shows_the_report_on_a_phone_and_on_a_desk_in_light_and_in_dark() {
    needs chromium chromium
    with_calibration
    report-html case embedded made >log
    local scheme
    for scheme in light dark; do
        with_browser $scheme >frames
        cat frames
        same "$(cut -d ' ' -f 1-10 frames)" "width 1200 scheme $scheme paper $scheme pictures 6 beyond 0
width 390 scheme $scheme paper $scheme pictures 6 beyond 0"
        # Letters of 9 pixels at the least, a contrast of 4.5 (that of WCAG for text), nothing loaded.
        awk '$12 < 9 || $14 < 4.5 || $16 != 0 { exit 1 }' frames
    done
}

# How many pages a browser prints of a file.
with_printer() {
    timeout 120 chromium --headless=new --no-sandbox --disable-gpu --user-data-dir="$PWD/profile" \
        --print-to-pdf=printed.pdf "file://$PWD/$1" >log 2>&1
    # They say so themselves, uncompressed.
    grep -ac '/Type */Page\b' printed.pdf
}

a_report_prints_without_the_pictures_for_a_phone() {
    needs chromium chromium
    with_calibration
    report-html case embedded made >log
    sed 's/^\.mm80 { display: none; }//' made/report.html >both.html
    local pages both
    pages=$(with_printer made/report.html)
    both=$(with_printer both.html)
    echo "$pages pages, $both with the pictures for a phone"
    [ "$pages" -ge 2 ] && [ "$pages" -lt "$both" ]
}

runs_that_failed_are_listed_with_their_reason() {
    with_calibration
    rm made/iter1/runs/contact_Iter1_Sample03_sim.txt
    rm made/iter1/{ensemble.txt,misfit.txt,weights.txt,posterior-weights.txt,stop.code,stop.txt}
    gl-collect -s made/iter1/samples.txt -b case/obs.txt -c u -v f,t --status made/iter1/status.txt \
        -o made/iter1/ensemble.txt made/iter1/runs 2>log
    calibrate case embedded made >log 2>&1
    report-html case embedded made >log
    grep -q '<td>contact_Iter1_Sample03</td><td>missing</td>' made/report.html
}

names_cannot_break_the_page() {
    needs python3 python3
    with_calibration
    mv case 'a<b>&"c'
    report-html 'a<b>&"c' embedded made >log
    with_everything_in made/report.html 6
    grep -q '<h1>a&lt;b&gt;&amp;&quot;c</h1>' made/report.html
    same "$(grep -c '<b>' made/report.html)" 0
}

a_diagnosis_becomes_one_file_with_its_pictures() {
    needs python3 python3
    cp -r "$ROOT/examples/contact-effects" case
    sed -i 's/^NUM=.*/NUM=20/; s/^ITERATIONS=.*/ITERATIONS=2/' case/case.env
    make -s -f "$ROOT/scripts/diagnose.mk" CASE=case ENGINE=embedded OUT=made SEED=3 DESIGN_NUM=60 made/report.md >log 2>&1
    report-html case embedded made >log
    # What the call set, case.env does not.
    grep -q 'seed 3' made/report.md
    grep -q 'Seed 3' made/report.html
    grep -q 'make diagnose CASE=case ENGINE=embedded OUT=made' made/report.html
    # One more for the fit with the effect in, if one was found.
    with_everything_in made/report.html $((9 + $([ -s made/winner.txt ] && [ -n "$(cat made/winner.txt)" ] && echo 1 || echo 0)))
}

what_is_no_calibration_is_refused() {
    cp -r "$ROOT/examples/contact-effects" case
    ends_with 2 report-html case embedded nowhere
    says 'no calibration there'
    ends_with 2 report-html nocase embedded made
    says 'nocase/case.env: no such case'
}

facts "$@"
