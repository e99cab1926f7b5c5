# Everything a user or a developer types. `make` alone says what there is.

SHELL := /bin/bash
CASE ?= examples/collision
ENGINE ?= embedded
OUT ?= out/$(notdir $(CASE))
export PATH := $(CURDIR)/target/release:$(PATH)
export MAKE

help:
	@sed -n 's/^## //p' $(MAKEFILE_LIST)

## make build                          the tools, in target/release
build:
	@cargo build --release

## make calibrate CASE=… ENGINE=…      calibrate a case; ENGINE is embedded, local, yade-batch, slurm, pbs
##                 ITERATIONS=N        at most N iterations; MORE=N: N beyond those that are there
calibrate: build
	@scripts/calibrate $(CASE) $(ENGINE) $(OUT)

.PHONY: help build calibrate
