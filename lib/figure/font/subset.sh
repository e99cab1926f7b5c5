#!/bin/sh
# Makes DejaVuSans-subset.ttf from Debian's fonts-dejavu-core, with fonttools (pip install fonttools).
# Latin, Greek, Cyrillic, sub- and superscripts, and the mathematical signs that labels use.
set -eu
cd "$(dirname "$0")"
pyftsubset "${1:-/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf}" --output-file=DejaVuSans-subset.ttf \
    --unicodes=0020-017F,0370-03FF,0400-045F,2010-2027,2030,2032,2033,2070-209C,2113,2126,2190-2193,2202,2206,2211-221E,2248,2260,2264,2265,2300,FFFD \
    --no-hinting --layout-features= --drop-tables+=GPOS,GSUB,GDEF,FFTM --name-IDs=0,1,2,4,5,13 \
    --notdef-outline
