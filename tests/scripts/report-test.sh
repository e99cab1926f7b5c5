#!/bin/bash
# shellcheck source-path=SCRIPTDIR source=harness.sh
. "$(dirname "$0")/harness.sh"
export PATH=$ROOT/target/release:$PATH

# A finished calibration of the contact, in made; and a diagnosis of it.
with_calibration() { with_shared calibration with_case_by gl-calibrate; }
with_diagnosis() { with_shared diagnosis with_case_by gl-diagnose seed=3 design_num=60; }
with_case_by() {
    cp -r "$ROOT/examples/contact-effects" case
    local tool=$1
    shift
    "$tool" case num=20 iterations=2 "$@" --out made >log 2>&1 || { cat log; return 1; }
}

# with_everything_in PAGE PICTURES [SECTION...]: these sections and those of every page, and no others; every picture at both widths,
# nothing from elsewhere, every tag closed.
with_everything_in() {
    local sections
    sections=$(printf '%s\n' verdict calibrated stands posterior "${@:3}" failed again)
    same "$(grep -o '<section id="[a-z]*"' "$1" | cut -d '"' -f 2)" "$sections"
    same "$(grep -o '<a href="#[a-z]*"' "$1" | cut -d '#' -f 2 | tr -d '"' | sort -u)" "$(sort <<<"$sections")"
    if grep -nE 'https?:|<(script|link|img|iframe)|url\(' "$1"; then return 1; fi
    same "$(grep -c '<svg class="mm170"' "$1")" "$2"
    same "$(grep -c '<svg class="mm80"' "$1")" "$2"
    same "$(grep -c '<figcaption>' "$1")" "$2"
    python3 - "$1" <<'END'
import sys
from html.parser import HTMLParser

EMPTY = {"meta", "br", "path", "rect", "line", "circle", "wbr"}


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
    same "$(gl-report case --out made)" made/report.html
    with_everything_in made/report.html 6
    grep -q '2 iterations made 40 runs, of which 0 failed' made/report.html
    grep -q '<pre>gl-calibrate case --engine embedded --out made num=20 iterations=2</pre>' made/report.html
    # Words that a newcomer stumbles over are explained where they stand.
    grep -q 'the weights are tempered: every run counts nearly alike' made/report.html
    grep -q 'off in the calibration: w tau plastic' made/report.html
    # What is doubtful stands before everything else.
    same "$(grep -nE 'class="doubts"|id="calibrated"' made/report.html | sed 's/^[0-9]*://; s/.*\(doubts\|calibrated\).*/\1/' | paste -sd ' ')" 'doubts calibrated'
    # Effects that are off are no parameters of the posterior.
    same "$(sed -n '/id="posterior"/,/<figure>/s/^<tr><td>\([^< ]*\).*/\1/p' made/report.html | paste -sd ' ')" 'E_m nu mu'
    # A page has units on its axes, which the case gives.
    grep -q '>f (N)</text>' made/report.html
    same "$(grep -cE 'make [a-z]+ CASE' made/report.html)" 0
}

# The runs themselves have a history along the steps; draws through an emulator have none, but predict each reading
# from the others.
weights_of_the_runs_have_a_history_and_draws_a_prediction_of_each_reading() {
    needs python3 python3
    cp -r "$ROOT/examples/contact-effects" case
    gl-calibrate case num=20 iterations=2 posterior=runs --out made >log 2>&1
    gl-report case --out made >log
    with_everything_in made/report.html 6
    grep -q 'The weight of each run against each parameter' made/report.html
    same "$(grep -c 'gl-plot predictive' made/report.html)" 0
    rm -r made
    gl-calibrate case num=20 iterations=3 --out made >log 2>&1
    gl-report case --out made >log
    grep -q 'The posterior is one of draws through an emulator of the runs' made/report.html
    grep -q -- '-w made/posterior-runs-weights.txt --posterior made/posterior-curves.txt made/ensemble.txt -o' made/report.html
    grep -q 'gl-plot predictive -c u .* made/iter2/loo.txt -o' made/report.html
    grep -qE '<li>[0-9]+ of 162 readings lie in the (90|50) % band that the others predict for them' made/report.html
}

the_commands_of_the_pictures_draw_them() {
    with_calibration
    gl-report case --out made >log
    local command
    command=$(sed -n 's/.*<pre>\(gl-plot fit .*\) -o picture.pdf<\/pre>.*/\1/p' made/report.html | head -n 1)
    $command -o picture.pdf
    same "$(head -c 5 picture.pdf)" '%PDF-'
}

the_same_results_give_the_same_page() {
    with_calibration
    gl-report case --out made >log
    mv made/report.html first.html
    gl-report case --out made >log
    cmp first.html made/report.html
}

# A browser that now and then does not start is started again.
with_chromium() {
    local -a call=(timeout 120 chromium --headless=new --no-sandbox --disable-gpu --user-data-dir="$PWD/profile" "$@")
    "${call[@]}" || { rm -rf profile; "${call[@]}"; }
}

# The report in a browser: what the frames of browser.html say, and nothing on its console.
with_browser() {
    local scheme=$1 number
    number=$([ "$scheme" = dark ] && echo 0 || echo 1)
    cp "$ROOT/tests/scripts/browser.html" .
    { sed '/<\/body>/,$d' made/report.html; echo '<script>'; cat "$ROOT/tests/scripts/browser.js"; echo '</script>'; } >report.html
    # Of its own complaints, such as of a bus that is missing, only those of the page count.
    with_chromium --blink-settings=preferredColorScheme="$number" --virtual-time-budget=5000 --window-size=1800,900 \
        --enable-logging=stderr --dump-dom "file://$PWD/browser.html" >dom.html 2>log
    if grep CONSOLE log; then return 1; fi
    grep -o '<p>width [^<]*' dom.html | sort | sed 's/<p>//'
}

a_browser_shows_the_report_on_a_phone_and_on_a_desk_in_light_and_in_dark() {
    needs chromium chromium
    with_diagnosis
    gl-report case --out made >log
    local scheme pictures
    pictures=$(grep -c '<figcaption>' made/report.html)
    for scheme in light dark; do
        with_browser $scheme >frames
        cat frames
        # Tables are never cut at 1280 pixels; on a phone they scroll in their own frames.
        same "$(cut -d ' ' -f 1-10 frames)" "width 1280 scheme $scheme paper $scheme pictures $pictures beyond 0
width 390 scheme $scheme paper $scheme pictures $pictures beyond 0"
        same "$(sed -n 's/^width 1280 .* cut \([0-9]*\).*/\1/p' frames)" 0
        # Letters of 9 pixels at the least, a contrast of 4.5 (that of WCAG for text), nothing loaded.
        awk '$12 < 9 || $14 < 4.5 || $16 != 0 { exit 1 }' frames
    done
}

# How many pages a browser prints of a file.
with_printer() {
    with_chromium --print-to-pdf=printed.pdf "file://$PWD/$1" >log 2>&1
    # They say so themselves, uncompressed.
    grep -ac '/Type */Page\b' printed.pdf
}

a_report_prints_without_the_pictures_for_a_phone() {
    needs chromium chromium
    with_calibration
    gl-report case --out made >log
    sed 's/^\.mm80 { display: none; }//' made/report.html >both.html
    local pages both
    pages=$(with_printer made/report.html)
    both=$(with_printer both.html)
    echo "$pages pages, $both with the pictures for a phone"
    [ "$pages" -ge 2 ] && [ "$pages" -lt "$both" ]
}

runs_that_failed_are_listed_with_their_reason() {
    with_calibration
    local status=made/iter1/status.txt
    sed 's/^contact_Iter1_Sample03\tok\t-/contact_Iter1_Sample03\tmissing\tno file/' "$status" >status.txt
    mv status.txt "$status"
    gl-report case --out made >log
    grep -q '<td>contact_Iter1_Sample03</td><td>missing</td><td>no file</td>' made/report.html
    grep -q '<li>1 missing</li>' made/report.html
}

names_cannot_break_the_page() {
    needs python3 python3
    with_calibration
    mv case 'a<b>&"c'
    gl-report 'a<b>&"c' --out made >log
    with_everything_in made/report.html 6
    grep -q '<h1>a&lt;b&gt;&amp;&quot;c</h1>' made/report.html
    same "$(grep -c '<b>' made/report.html)" 0
}

a_diagnosis_becomes_one_file_with_its_pictures_and_one_for_reading() {
    needs python3 python3
    with_diagnosis
    gl-report case --out made >log
    # What the call set, case.toml does not.
    grep -q 'seed 3' made/report.md
    grep -q 'seed 3' made/report.html
    grep -q 'gl-diagnose case --engine embedded --out made num=20 seed=3 design_num=60 iterations=2' made/report.html
    # Six more for the calibration with the effect in, if one was found.
    same "$(grep -c '<pre>gl-.* -o picture.pdf</pre>' made/report.html)" "$(grep -c '<figcaption>' made/report.html)"
    if grep -o '<pre>gl-.* -o picture.pdf</pre>' made/report.html | grep -F /tmp; then return 1; fi
    with_everything_in made/report.html $((10 + 6 * $([ -s made/winner.txt ] && [ -n "$(cat made/winner.txt)" ] && echo 1 || echo 0))) gap cause closed
}

# A verdict says by its code what it means; its words may be any.
a_headline_is_told_by_the_code_of_the_verdict() {
    with_diagnosis
    local code
    while read -r code; do
        printf 'code\tvalue\ttext\nleans\tnu\tsome words\n%s\tadhesion\tother <words>\n' "$code" >made/attribution-verdict.txt
        gl-report case --out made >log
        sed -n 's/^<p class="answer">\(.*\)/\1/p; s/^<li>\(Some words\.\)<\/li>/doubt: \1/p' made/report.html | head -n 2
        grep -q '<li>Other &lt;words&gt;.</li>' made/report.html
    done >headlines <<<'cause
unexplained
unsettled'
    same "$(cat headlines)" 'adhesion explains the gap.
doubt: Some words.
None of the candidates explains the gap.
doubt: Some words.
Not settled: adhesion is the most probable cause.
doubt: Some words.'
    printf 'code\tvalue\ttext\nunsettled\tadhesion\tno run shows it\nuntried\t3\tfurther runs would tell\n' >made/attribution-verdict.txt
    gl-report case --out made >log
    same "$(sed -n 's/^<p class="answer">//p' made/report.html)" 'Not settled: adhesion comes first, but no run shows it.'
    printf 'code\tvalue\ttext\nunsettled\tunexplained\tnoise does as well\nmeasure-again\t6\tonce more\n' >made/attribution-verdict.txt
    gl-report case --out made >log
    same "$(sed -n 's/^<p class="answer">//p' made/report.html)" 'Not settled: something else seems to be at work, or noise alone; a second measurement would tell.'
    printf 'code\tvalue\ttext\ncause\tadhesion\tit explains it\n' >made/attribution-verdict.txt
    printf 'code\tvalue\ttext\nmay-not-close\t0.07\tthe gap closes by 7 %%\n' >made/shrink-verdict.txt
    gl-report case --out made >log
    same "$(sed -n 's/^<p class="answer">//p' made/report.html)" 'adhesion was named, but with it in the simulation the gap may not close at all.'
}

what_is_no_calibration_is_refused() {
    cp -r "$ROOT/examples/contact-effects" case
    ends_with 2 gl-report case --out nowhere
    says 'nowhere: no calibration there; gl-calibrate case --out nowhere makes one'
    ends_with 2 gl-report nocase --out made
    says 'nocase/case.toml: no such case'
}

facts "$@"
