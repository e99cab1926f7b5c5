# One round of a design and what it says: make -f scripts/attribute.mk CASE=… ENGINE=… OUT=… R=0
#
# OUT/design/roundR/params.txt is the table of parameters that the round draws from, the first one from the
# base calibration in OUT/base. roundR/samples.txt switches effects on and off all over it, unless
# scripts/attribute has put the samples there that the round before asked for (next.txt). The attribution
# is made from the runs of all rounds so far. Each file appears whole or not at all. scripts/attribute calls
# this for R = 0, 1, …

SCRIPTS := $(dir $(lastword $(MAKEFILE_LIST)))
include $(SCRIPTS)columns.mk

R ?= 0
D := $(OUT)/design/round$(R)
ALL := $(foreach r,$(shell seq 0 $(R)),$(OUT)/design/round$(r))
# Runs of the design in all, 25 for each parameter: three fifths in the first round, the rest where that one
# asks for them. A round between them, in a wider box, takes half as many again.
DESIGN_NUM ?= $(shell awk 'NF && !/^[ \t]*\043/ { rows++ } END { print 25 * (rows - 1) }' $(PARAMS))
FIRST_NUM = $$(( $(DESIGN_NUM) - $(DESIGN_NUM) * 2 / 5 ))
WIDER_NUM = $$(( $(DESIGN_NUM) / 2 ))
NEXT_NUM = $$(( $(DESIGN_NUM) * 2 / 5 ))
SEED ?= 0
MAX_FAILED ?= 0.5
export CASE

.DELETE_ON_ERROR:
.SUFFIXES:

$(D)/attribution.txt: $(D)/all-ensemble.txt
	@gl-gap-attribute -p $(D)/params.txt -s $(D)/all-samples.txt -b $(OBS) -c $(CONTROL_NAME) -v $(OBSERVABLE_NAMES) \
	 $(call option,--noise,$(NOISE)) $(call option,--measurement,$(MEASUREMENT)) \
	 $(call option,--max-effects,$(MAX_EFFECTS)) $(call option,--scatter,$(SCATTER)) \
	 --effects-out $(D)/effects.txt --predict-shrink $(D)/predicted-shrink.txt --posterior-out $(D)/posterior.txt \
	 --next-out $(D)/next.txt --next $(NEXT_NUM) --name $(NAME)-design --iteration $$(( $(R) + 1 )) $(call option,--threads,$(THREADS)) \
	 --seed $(SEED) -o $@ $< 2>$(D)/attribution.log || { cat $(D)/attribution.log >&2; exit 2; }

$(D)/all-ensemble.txt: $(ALL:%=%/ensemble.txt)
	@awk 'FNR > 1 || NR == 1' $(ALL:%=%/samples.txt) >$(D)/all-samples.txt
	@awk 'FNR > 1 || NR == 1' $(ALL:%=%/status.txt) >$(D)/all-status.txt
	@awk 'FNR > 1 || NR == 1' $^ >$(D)/.all-ensemble.txt.part && mv $(D)/.all-ensemble.txt.part $@

$(D)/ensemble.txt: $(D)/samples.txt $(OBS)
	@"$(SCRIPTS)run-$(ENGINE)" $(RUN_OPTIONS) $< '$(ENGINE_MODEL)' $(D)/runs
	@gl-collect -s $< -b $(OBS) -c '$(CONTROL)' -v '$(OBSERVABLES)' --max-failed $(MAX_FAILED) \
	 --status $(D)/status.txt -o $@ $(D)/runs

$(D)/samples.txt: $(D)/params.txt
	@gl-sample -p $< -n $(if $(filter-out 0,$(R)),$(WIDER_NUM),$(FIRST_NUM)) --effects switch \
	 $(call option,--threads,$(THREADS)) --seed $$(($(SEED) + $(R))) --name $(NAME)-design --iteration $(R) -o $@

ifeq ($(R),0)
$(D)/params.txt: $(PARAMS) $(OUT)/base/posterior-weights.txt
	@mkdir -p $(D)
	@awk -f "$(SCRIPTS)narrow.awk" $^ >$(D)/.params.txt.part && mv $(D)/.params.txt.part $@
endif

# Earlier rounds are made by earlier calls.
$(foreach d,$(filter-out $(D),$(ALL)),$(d)/ensemble.txt): ;
