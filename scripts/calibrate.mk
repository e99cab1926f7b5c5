# One iteration of a calibration: make -f scripts/calibrate.mk CASE=… ENGINE=… OUT=… I=0
#
# Each file is made from the ones before it, and appears whole or not at all, so that after an
# interruption the same call goes on where it was. scripts/calibrate calls this for I = 0, 1, 2, …

SCRIPTS := $(dir $(lastword $(MAKEFILE_LIST)))
include $(CASE)/case.env

I ?= 0
D := $(OUT)/iter$(I)
ALL := $(foreach i,$(shell seq 0 $(I)),$(OUT)/iter$(i))
PREVIOUS := $(if $(filter-out 0,$(I)),$(lastword $(filter-out $(D),$(ALL))))

# What the measurement calls the columns; gl-collect is also told what the runs call them.
comma := ,
measured = $(firstword $(subst =, ,$(1)))
CONTROL_NAME := $(call measured,$(CONTROL))
OBSERVABLE_NAMES := $(subst $() ,$(comma),$(foreach v,$(subst $(comma), ,$(OBSERVABLES)),$(call measured,$(v))))

PARAMS := $(CASE)/params.txt
OBS := $(CASE)/obs.txt
ENGINE_MODEL := $(or $(MODEL_$(subst -,_,$(ENGINE))),$(MODEL))
SEED ?= 0
SAMPLING ?= slice
ESS ?= 0.3
MAX_FAILED ?= 0.5
export CASE

option = $(if $(2),$(1) $(2))
SAMPLE := $(call option,--effects,$(EFFECTS)) $(call option,--threads,$(THREADS))
MISFIT := $(call option,--noise,$(NOISE)) $(call option,--scale,$(SCALE)) $(call option,--weights,$(WEIGHTS)) \
          $(call option,--steps,$(STEPS))
FILTER := -p $(PARAMS) $(foreach d,$(ALL),-s $(d)/samples.txt) --proposal prior \
          $(foreach d,$(filter-out $(OUT)/iter0,$(ALL)),--proposal $(d)/proposal.txt)
RESAMPLE := $(call option,--components,$(COMPONENTS)) $(call option,--covariance,$(COVARIANCE)) \
            $(call option,--threads,$(THREADS)) --sampling $(SAMPLING)
STOP := $(call option,--sigma-tol,$(SIGMA_TOL)) $(call option,--error-tol,$(ERROR_TOL)) \
        $(call option,--ensemble-error-tol,$(ENSEMBLE_ERROR_TOL))

.DELETE_ON_ERROR:
.SUFFIXES:

# 0 where a criterion says stop, 1 where it says go on.
$(D)/stop.code: $(D)/summary.txt $(D)/posterior.txt $(CASE)/case.env
	@code=0; gl-check-stop $(STOP) -o $(D)/stop.txt $< 2>$(D)/.stop.log || code=$$?; \
	 [ $$code -lt 2 ] || { cat $(D)/.stop.log >&2; exit 2; }; \
	 mv $(D)/.stop.log $(D)/stop.log; echo $$code >$@.part; mv $@.part $@

# What the next samples are drawn from: tempered, so that ESS of the runs of one iteration keep weight,
# but enough to see the shape of the posterior in (2 d + 4 with d parameters).
KEPT := $(shell awk 'NF && !/^[ \t]*\043/ { rows++ } END { least = 2 * (rows - 1) + 4; kept = $(ESS) * $(NUM); print (kept > least ? kept : least) }' $(PARAMS))
$(D)/summary.txt: $(foreach d,$(ALL),$(d)/misfit.txt)
	@gl-filter $(FILTER) --ess-runs $(KEPT) --sigma-min noise --history $(D)/history.txt --summary $@ \
	 -o $(D)/weights.txt $^ 2>$(D)/filter.log || { cat $(D)/filter.log >&2; exit 2; }

# The posterior itself, from all runs so far.
$(D)/posterior.txt: $(foreach d,$(ALL),$(d)/misfit.txt)
	@gl-filter $(FILTER) --sigma noise --summary $@ -o $(D)/posterior-weights.txt $^ 2>$(D)/posterior.log \
	 || { cat $(D)/posterior.log >&2; exit 2; }

$(D)/misfit.txt: $(D)/ensemble.txt
	@gl-likelihood -b $(OBS) -c $(CONTROL_NAME) -v $(OBSERVABLE_NAMES) $(MISFIT) -o $@ $<

$(D)/ensemble.txt: $(D)/samples.txt $(OBS)
	@"$(SCRIPTS)run-$(ENGINE)" $(D)/samples.txt '$(ENGINE_MODEL)' $(D)/runs
	@gl-collect -s $(D)/samples.txt -b $(OBS) -c '$(CONTROL)' -v '$(OBSERVABLES)' --max-failed $(MAX_FAILED) \
	 --status $(D)/status.txt -o $@ $(D)/runs 2>$(D)/collect.log || { cat $(D)/collect.log >&2; exit 2; }

ifeq ($(PREVIOUS),)
$(D)/samples.txt: $(PARAMS) $(CASE)/case.env
	@mkdir -p $(D)
	@gl-sample -p $(PARAMS) -n $(NUM) $(SAMPLE) --seed $(SEED) --name $(NAME) --iteration 0 -o $@
else
$(D)/samples.txt: $(PREVIOUS)/stop.code
	@mkdir -p $(D)
	@gl-gmm-resample -p $(PARAMS) -n $(NUM) $(RESAMPLE) --seed $$(($(SEED) + $(I))) --name $(NAME) \
	 --iteration $(I) --proposal-out $(D)/proposal.txt -o $@ $(PREVIOUS)/weights.txt 2>$(D)/resample.log \
	 || { cat $(D)/resample.log >&2; exit 2; }
endif

# Earlier iterations are made by earlier calls.
$(foreach d,$(filter-out $(D),$(ALL)),$(d)/misfit.txt $(d)/stop.code): ;
