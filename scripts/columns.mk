# What calibrate.mk and diagnose.mk read from a case: its tables, its model, the names of its columns.

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
