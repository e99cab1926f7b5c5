# What a user or a developer types; `make` alone lists it.

SHELL := /bin/bash
CASE ?= examples/collision
OUT ?= out/$(notdir $(CASE))
PREFIX ?= /usr/local
BIN := $(or $(CARGO_TARGET_DIR),target)/release
# What is built here, and nothing else of that name.
export PATH := $(abspath $(BIN)):$(PATH)
export MAKE

# make parts its words at blanks.
$(foreach name,CASE OUT,$(if $(word 2,$($(name))),$(error $(name)=$($(name)): a path with blanks cannot go through make; call gl-calibrate and the others, which take any path)))

SHARE = $(DESTDIR)$(PREFIX)/share
TOOLS := $(notdir $(wildcard tools/gl-*))

# Settings of case.toml that win over it when they are given to make or in its environment.
# `value`, so that nothing in them is expanded.
SETTINGS := NUM SEED MODEL NOISE SCALE WEIGHTS STEPS SIGMA_TOL ERROR_TOL ENSEMBLE_ERROR_TOL MISFIT_TOL MAX_FAILED THREADS PACKED KEPT
SETTINGS += ESS EMULATED POSTERIOR SAMPLING COMPONENTS COVARIANCE EFFECTS DESIGN_NUM MEASUREMENT MAX_EFFECTS SCATTER
quoted = '$(subst ','\'',$(1))'
GIVEN = $(foreach key,$(SETTINGS),$(if $(value $(key)),$(call quoted,$(key)=$(value $(key)))))
FOR = $(CASE) $(if $(ENGINE),--engine $(ENGINE)) --out $(OUT)
LIMITS = $(if $(ITERATIONS),--iterations $(ITERATIONS)) $(if $(MORE),--more $(MORE))

help:
	@sed -n 's/^## //p' $(MAKEFILE_LIST)

## make demo                        build; calibrate a contact between two spheres; the posterior and a picture.
##                                  ENGINE=yade-batch does it with Yade
DEMO := out/demo-$(or $(ENGINE),embedded)
demo: build
	@gl-calibrate examples/collision $(if $(ENGINE),--engine $(ENGINE)) --out $(DEMO)
	@gl-plot fit -b examples/collision/obs.txt -c u -v f --units u=m,f=N -w $(DEMO)/posterior-runs-weights.txt --posterior $(DEMO)/posterior-curves.txt \
	 $(DEMO)/ensemble.txt -o $(DEMO)/fit.png
	@echo; echo "The fit is drawn in $(DEMO)/fit.png, the tables stand beside it."
	@echo "make report OUT=$(DEMO) puts all of it on a page; docs/tutorial.md goes on from here."

## make test                        everything: the library, the tools, the scripts, the engines that are here
test: build
	@# One at a time more than there are processors: one of them waits for schedulers.
	@RUST_TEST_THREADS=$$(($$(nproc) + 1)) cargo test --release --workspace --no-fail-fast

## make build                       the tools, in target/release
build:
	@cargo build --release --workspace $(BUILD_OPTIONS)

## make calibrate CASE=… ENGINE=…   calibrate a case with ENGINE embedded, local, yade-batch, slurm or pbs;
##                                  ITERATIONS=N at most, or MORE=N beyond those that are there; into OUT.
##                                  Settings of case.toml, such as NUM=N or SEED=N, win over it
calibrate: build
	@gl-calibrate $(FOR) $(LIMITS) $(GIVEN)

## make check CASE=…                what is wrong with a case, and what it will take
check: build
	@gl-check $(FOR) $(if $(ITERATIONS),iterations=$(ITERATIONS)) $(GIVEN)

## make iteration CASE=… SAMPLES=… RUNS=…   one iteration of runs that were made elsewhere, and the next samples;
##                                  ITERATION=1, 2, … goes on; into OUT
iteration: build
	@gl-iterate $(CASE) $(SAMPLES) $(RUNS) --iteration $(or $(ITERATION),0) --out $(OUT) $(GIVEN) || [ $$? -eq 1 ]

## make submit CASE=…              the same in the queue of SLURM (ENGINE=pbs: of PBS), with nothing that must stay connected;
##                                  make status and make cancel OUT=… show its progress and end it
submit: build
	@gl-submit $(FOR) $(LIMITS) $(GIVEN)
status: build
	@gl-status $(OUT) || [ $$? -eq 1 ]
cancel: build
	@gl-cancel $(OUT)

## make report CASE=…               a calibration or diagnosis as one HTML file with its pictures
report: OUT := $(if $(filter file,$(origin OUT)),$(firstword $(wildcard out/$(notdir $(CASE))-diagnosis) $(OUT)),$(OUT))
report: build
	@gl-report $(FOR) $(GIVEN)

## make diagnose CASE=… ENGINE=…    calibrate, locate the gap, find its cause, see how far it closes; OUT/report.md
diagnose: OUT := out/$(notdir $(CASE))-diagnosis
diagnose: build
	@gl-diagnose $(FOR) $(if $(ITERATIONS),iterations=$(ITERATIONS)) $(GIVEN)

## make withheld CASES=200           how often the diagnosis finds an effect that it is not told; about 40 minutes.
##                                  RUNS=10: runs of the design an input, SEED=…: other cases,
##                                  CONDITION=remainder-2: what is otherwise than assumed, or all of them: CONDITION=all
##                                  (as stated with SEED, the next with the seed after it, and so on),
##                                  WORLDS="triaxial-one triaxial-three": one test, and three at other cell pressures,
##                                  NO_CANDIDATE=yes: of these cases those whose effect is no candidate;
##                                  `withheld weigh out/withheld/*` weighs them by other rules, without runs,
##                                  `withheld page out/withheld/*` has the tables of docs/diagnosis-accuracy.md
CASES ?= 200
WORLDS ?= contact triaxial
CONDITION ?= as-stated
NO_CANDIDATE ?=
CONDITIONS = as-stated noise-0.5 noise-0.85 noise-2 noise-5 unstated correlated-0.5 correlated-0.9 heavy-tails outliers \
    remainder-1 remainder-2 remainder-4 other-form outside beyond idle one-observable ten-steps
withheld: RUNS := $(or $(RUNS),25)
withheld: SEED := $(or $(SEED),9006)
withheld: build
	@seed=$(SEED); for condition in $(if $(filter all,$(CONDITION)),$(CONDITIONS),$(CONDITION)); do dirs=; \
	     for world in $(WORLDS); do dir=out/withheld/$$world-$$condition-$(RUNS)-$$seed$(if $(NO_CANDIDATE),-no-candidate); mkdir -p $$dir; \
	         echo "## $$world, $$condition"; \
	         withheld generate $$world $$dir --num $(CASES) --seed $$seed --condition $$condition $(if $(NO_CANDIDATE),--no-candidate) && \
	         withheld diagnose $$world $$dir --runs $(RUNS) --condition $$condition && \
	         withheld score $$dir | tee $$dir/score.tsv || exit; dirs="$$dirs $$dir"; done; \
	     echo "## both, $$condition"; withheld score $$dirs || exit; seed=$$((seed + 1)); done

## make coverage REPLICATES=30       how often the intervals of a calibration hold and how many runs it takes, on problems in
##                                  closed form; SEED=…: other truths
REPLICATES ?= 30
coverage: build
	@mkdir -p out/coverage; coverage -n $(REPLICATES) --seed $(or $(SEED),700) | tee out/coverage/coverage.tsv

## make bench                       the tools beside GrainLearning on the same data; BENCH=full for the long tasks
bench: build
	@scripts/dev/bench/run

## make site                        README, docs and examples as pages with links, in out/site; they need no network
site: build
	@rm -rf out/site
	@site out/site
	@echo "The site begins with out/site/index.html"

## make man                         manual pages and completions, in out/man
man: build
	@mkdir -p out/man
	@for tool in $(TOOLS); do for kind in man bash zsh fish; do \
	     $(BIN)/$$tool --generate $$kind >out/man/$$tool.$${kind/man/1} || exit; done; \
	 for kind in $$($(BIN)/$$tool --generate kinds); do \
	     $(BIN)/$$tool --generate man $$kind >out/man/$$tool-$$kind.1 || exit; done; done

## make install PREFIX=…            tools, scripts, examples, manual pages and completions
install: man
	@install -d $(SHARE)/gl $(SHARE)/man/man1 $(SHARE)/bash-completion/completions $(SHARE)/zsh/site-functions \
	 $(SHARE)/fish/vendor_completions.d $(DESTDIR)$(PREFIX)/bin
	@install --strip $(TOOLS:%=$(BIN)/%) $(DESTDIR)$(PREFIX)/bin
	@cp -r scripts examples $(SHARE)/gl
	@for tool in $(TOOLS); do \
	     for kind in '' $$($(BIN)/$$tool --generate kinds | sed s/^/-/); do \
	         install -m 644 out/man/$$tool$$kind.1 $(SHARE)/man/man1/; done; \
	     install -m 644 out/man/$$tool.bash $(SHARE)/bash-completion/completions/$$tool; \
	     install -m 644 out/man/$$tool.zsh $(SHARE)/zsh/site-functions/_$$tool; \
	     install -m 644 out/man/$$tool.fish $(SHARE)/fish/vendor_completions.d/; done

## make dist                        all of that in out/gl-VERSION-x86_64-linux.tar.gz, which runs wherever it is
##                                  unpacked: the tools are linked statically, and tried in an empty chroot
TARGET := x86_64-unknown-linux-gnu
RELEASE := gl-$(shell sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml)-x86_64-linux
dist:
	@rm -rf out/$(RELEASE)
	@RUSTFLAGS='-C target-feature=+crt-static' $(MAKE) --no-print-directory install DESTDIR= PREFIX=out/$(RELEASE) \
	 BIN=$(or $(CARGO_TARGET_DIR),target)/$(TARGET)/release BUILD_OPTIONS='--exclude pipelines --target $(TARGET)'
	@cp -r README.md CHANGELOG.md LICENSE-* docs out/$(RELEASE)
	@tar -C out --sort=name --owner=0 --group=0 --numeric-owner -czf out/$(RELEASE).tar.gz.part $(RELEASE)
	@tests/dist/check out/$(RELEASE).tar.gz.part
	@mv out/$(RELEASE).tar.gz.part out/$(RELEASE).tar.gz
	@echo "The release is out/$(RELEASE).tar.gz"

## make clean                       what calibrations wrote; the build stays
clean:
	@rm -rf out

.PHONY: help demo test build calibrate check iteration submit status cancel report diagnose withheld coverage bench site man install dist clean
