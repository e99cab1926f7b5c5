# What a user or a developer types; `make` alone lists it.

SHELL := /bin/bash
CASE ?= examples/collision
ENGINE ?= embedded
OUT ?= out/$(notdir $(CASE))
PREFIX ?= /usr/local
export PATH := $(CURDIR)/target/release:$(CURDIR)/scripts:$(PATH)
export MAKE

SHARE = $(DESTDIR)$(PREFIX)/share
TOOLS := $(notdir $(wildcard tools/gl-*))

help:
	@sed -n 's/^## //p' $(MAKEFILE_LIST)

## make demo                        build; calibrate a contact between two spheres; the posterior and a picture.
##                                  ENGINE=yade-batch does it with Yade
demo: build
	@scripts/calibrate examples/collision $(ENGINE) out/demo-$(ENGINE)
	@gl-plot fit -b examples/collision/obs.txt -c u -v f -w out/demo-$(ENGINE)/posterior-weights.txt \
	 out/demo-$(ENGINE)/ensemble.txt -o out/demo-$(ENGINE)/fit.png
	@echo; echo "The fit is drawn in out/demo-$(ENGINE)/fit.png, the tables stand beside it."

## make test                        everything: the library, the tools, the scripts, the engines that are here
test: build
	@cargo test --release --workspace

## make build                       the tools, in target/release
build:
	@cargo build --release --workspace

## make calibrate CASE=… ENGINE=…   calibrate a case with ENGINE embedded, local, yade-batch, slurm or pbs;
##                                  ITERATIONS=N at most, or MORE=N beyond those that are there; into OUT
calibrate: build
	@scripts/calibrate $(CASE) $(ENGINE) $(OUT)

## make submit CASE=…              the same in the queue of SLURM, with nothing that must stay connected;
##                                  make status and make cancel OUT=… say how it gets on and end it
submit: build
	@scripts/submit $(CASE) $(OUT)
status:
	@scripts/status $(OUT) || [ $$? -eq 1 ]
cancel:
	@scripts/cancel $(OUT)

## make report CASE=…               a calibration or diagnosis as one HTML file with its pictures
report: build
	@scripts/report-html $(CASE) $(ENGINE) $(firstword $(wildcard out/$(notdir $(CASE))-diagnosis) $(OUT))

## make diagnose CASE=… ENGINE=…    calibrate, locate the gap, find its cause, see how far it closes; OUT/report.md
diagnose: OUT := out/$(notdir $(CASE))-diagnosis
diagnose: build
	@mkdir -p $(OUT)
	@$(MAKE) --no-print-directory -s -f scripts/diagnose.mk CASE=$(CASE) ENGINE=$(ENGINE) OUT=$(OUT) $(OUT)/report.md
	@echo "The report is $(OUT)/report.md"

## make withheld CASES=200           how often the diagnosis finds an effect that it is not told; about 10 minutes.
##                                  RUNS=10: runs of the design an input, SEED=…: other cases
CASES ?= 200
RUNS ?= 25
SEED ?= 7001
withheld: build
	@for world in contact triaxial; do dir=out/withheld/$$world-$(RUNS)-$(SEED); mkdir -p $$dir; echo "## $$world"; \
	     withheld generate $$world $$dir --num $(CASES) --seed $(SEED) && \
	     withheld diagnose $$world $$dir --runs $(RUNS) && \
	     withheld score $$dir | tee $$dir/score.tsv || exit; done

## make bench                       the tools beside GrainLearning on the same data; BENCH=full for the long tasks
bench: build
	@scripts/bench/run

## make man                         manual pages and completions, in out/man
man: build
	@mkdir -p out/man
	@for tool in $(TOOLS); do for kind in man bash zsh fish; do \
	     $$tool --generate $$kind >out/man/$$tool.$${kind/man/1} || exit; done; done

## make install PREFIX=…            tools, scripts, examples, manual pages and completions
install: man
	@install -d $(SHARE)/gl $(SHARE)/man/man1 $(SHARE)/bash-completion/completions $(SHARE)/zsh/site-functions \
	 $(SHARE)/fish/vendor_completions.d $(DESTDIR)$(PREFIX)/bin
	@install $(TOOLS:%=target/release/%) $(DESTDIR)$(PREFIX)/bin
	@cp -r scripts examples $(SHARE)/gl
	@for tool in $(TOOLS); do \
	     install -m 644 out/man/$$tool.1 $(SHARE)/man/man1/; \
	     install -m 644 out/man/$$tool.bash $(SHARE)/bash-completion/completions/$$tool; \
	     install -m 644 out/man/$$tool.zsh $(SHARE)/zsh/site-functions/_$$tool; \
	     install -m 644 out/man/$$tool.fish $(SHARE)/fish/vendor_completions.d/; done

## make clean                       what calibrations wrote; the build stays
clean:
	@rm -rf out

.PHONY: help demo test build calibrate submit status cancel report diagnose withheld bench man install clean
