# What calibrate.mk and diagnose.mk read from a case: its settings, its tables, its model, the names of its
# columns.

# Settings that the environment wins over case.env with. The scripts read these lines, too.
SETTINGS := NUM SEED MODEL NOISE SCALE WEIGHTS STEPS SIGMA_TOL ERROR_TOL ENSEMBLE_ERROR_TOL MAX_FAILED THREADS
SETTINGS += ESS EMULATED SAMPLING COMPONENTS COVARIANCE EFFECTS DESIGN_NUM MEASUREMENT MAX_EFFECTS SCATTER
$(foreach key,$(SETTINGS),$(if $(and $(filter environment,$(origin $(key))),$($(key))),$(eval override $(key) := $$($(key)))))
include $(CASE)/case.env

# Where no tools are in PATH: those that were built or installed with these scripts.
export PATH := $(PATH):$(abspath $(SCRIPTS)../target/release):$(abspath $(SCRIPTS)../../../bin)

PARAMS := $(CASE)/params.txt
OBS := $(CASE)/obs.txt
ENGINE_MODEL := $(or $(MODEL_$(subst -,_,$(ENGINE))),$(MODEL))

# What the measurement calls the columns; gl-collect is also told what the runs call them.
comma := ,
measured = $(firstword $(subst =, ,$(1)))
CONTROL_NAME := $(call measured,$(CONTROL))
OBSERVABLE_NAMES := $(subst $() ,$(comma),$(foreach v,$(subst $(comma), ,$(OBSERVABLES)),$(call measured,$(v))))

option = $(if $(2),$(1) $(2))
