# One iteration of a calibration: make -f scripts/calibrate.mk CASE=… ENGINE=… OUT=… I=0
#
# Without an ENGINE nothing is run: the runs are in OUT/iterI/runs already.
#
# Each file is made from the ones before it, and appears whole or not at all, so that after an
# interruption the same call goes on where it was. scripts/calibrate calls this for I = 0, 1, 2, …

SCRIPTS := $(dir $(lastword $(MAKEFILE_LIST)))
include $(SCRIPTS)columns.mk

I ?= 0
D := $(OUT)/iter$(I)
ALL := $(foreach i,$(shell seq 0 $(I)),$(OUT)/iter$(i))
PREVIOUS := $(if $(filter-out 0,$(I)),$(lastword $(filter-out $(D),$(ALL))))

SEED ?= 0
SAMPLING ?= mixture
ESS ?= 0.2
EMULATED ?= 1000
MAX_FAILED ?= 0.5
export CASE PACKED
# What the settings are; scripts/calibrate notes there which the environment has.
GIVEN := $(CASE)/case.env $(wildcard $(OUT)/settings.env)

SAMPLE := $(call option,--effects,$(EFFECTS)) $(call option,--threads,$(THREADS))
COMPARE := -b $(OBS) -c $(CONTROL_NAME) -v $(OBSERVABLE_NAMES) $(call option,--noise,$(NOISE)) $(call option,--scale,$(SCALE)) $(call option,--weights,$(WEIGHTS)) \
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
$(D)/stop.code: $(D)/weights.txt $(D)/posterior-weights.txt $(GIVEN)
	@code=0; gl-check-stop $(STOP) --previous $(if $(PREVIOUS),$(PREVIOUS)/summary.txt,none) -o $(D)/stop.txt $(D)/summary.txt 2>$(D)/.stop.log || code=$$?; \
	 [ $$code -lt 2 ] || { cat $(D)/.stop.log >&2; exit 2; }; \
	 mv $(D)/.stop.log $(D)/stop.log; echo $$code >$(D)/.stop.code.part; mv $(D)/.stop.code.part $@

# What the next samples are drawn from: tempered, so that enough runs keep weight.
# Of what gl-filter writes the weights come last, so that they stand for all of it.
$(D)/weights.txt: $(foreach d,$(ALL),$(d)/misfit.txt)
	@kept=$$(awk -v share=$(ESS) -f "$(SCRIPTS)kept.awk" $(D)/samples.txt); \
	 gl-filter $(FILTER) --ess-runs $$kept --sigma-min noise --history $(D)/history.txt \
	 --summary $(D)/summary.txt -o $@ $^ 2>$(D)/filter.log || { cat $(D)/filter.log >&2; exit 2; }

# The posterior itself, from all runs so far.
$(D)/posterior-weights.txt: $(foreach d,$(ALL),$(d)/misfit.txt)
	@gl-filter $(FILTER) --sigma noise --summary $(D)/posterior.txt -o $@ $^ 2>$(D)/posterior.log \
	 || { cat $(D)/posterior.log >&2; exit 2; }

$(D)/misfit.txt: $(D)/ensemble.txt
	@gl-likelihood $(COMPARE) -o $@ $<

$(D)/ensemble.txt: $(D)/samples.txt $(OBS)
	@$(if $(ENGINE),"$(SCRIPTS)run-$(ENGINE)" $(RUN_OPTIONS) $(D)/samples.txt '$(ENGINE_MODEL)' $(D)/runs)
	@gl-collect -s $(D)/samples.txt -b $(OBS) -c '$(CONTROL)' -v '$(OBSERVABLES)' --max-failed $(MAX_FAILED) \
	 --status $(D)/status.txt -o $@ $(D)/runs 2>$(D)/collect.log || { cat $(D)/collect.log >&2; exit 2; }

ifeq ($(PREVIOUS),)
$(D)/samples.txt: $(PARAMS) $(GIVEN)
	@mkdir -p $(D)
	@gl-sample -p $(PARAMS) -n $(NUM) $(SAMPLE) --seed $(SEED) --name $(NAME) --iteration 0 -o $@
else
# The weights that the next samples are drawn by: those of emulated samples, where there are any.
DRAWN_BY := $(PREVIOUS)/$(if $(filter-out 0,$(EMULATED)),emulated-)weights.txt

$(PREVIOUS)/emulated-weights.txt: $(PREVIOUS)/stop.code
	@"$(SCRIPTS)emulated-weights" $(PARAMS) $(OUT) $$(($(I) - 1)) $$((1000 * ($(SEED) + $(I)))) $(EMULATED) '$(COMPARE)' \
	 2>$(PREVIOUS)/emulated.log || { cat $(PREVIOUS)/emulated.log >&2; exit 2; }

$(D)/samples.txt: $(PREVIOUS)/stop.code $(DRAWN_BY)
	@mkdir -p $(D)
	@gl-gmm-resample -p $(PARAMS) -n $(NUM) $(RESAMPLE) --seed $$(($(SEED) + $(I))) --name $(NAME) \
	 --iteration $(I) --proposal-out $(D)/proposal.txt -o $@ $(DRAWN_BY) 2>$(D)/resample.log \
	 || { cat $(D)/resample.log >&2; exit 2; }
endif

# Earlier iterations are made by earlier calls.
$(foreach d,$(filter-out $(D),$(ALL)),$(d)/misfit.txt $(d)/stop.code): ;
