# The diagnosis of a case: make -f scripts/diagnose.mk CASE=… ENGINE=… OUT=… OUT/report.md
#
# Calibrate the base model, locate the gap, run a design in which every effect is on and off, attribute
# the gap to an effect, calibrate again with the effect in, and see how far the gap closes. Each file
# appears whole or not at all, so that after an interruption the same call goes on where it was.

SCRIPTS := $(dir $(lastword $(MAKEFILE_LIST)))
include $(SCRIPTS)columns.mk

BASE := $(OUT)/base
AFTER := $(OUT)/after
COMMON := -b $(OBS) -c $(CONTROL_NAME) -v $(OBSERVABLE_NAMES) $(call option,--noise,$(NOISE))
export CASE

.DELETE_ON_ERROR:
.SUFFIXES:

$(OUT)/report.md: $(OUT)/locate.txt $(OUT)/attribution.txt $(OUT)/shrink.txt
	@"$(SCRIPTS)report" $(CASE) $(ENGINE) $(OUT) >$(OUT)/.report.md.part
	@mv $(OUT)/.report.md.part $@

$(BASE)/posterior.txt: $(PARAMS) $(OBS) $(CASE)/case.env
	@"$(SCRIPTS)calibrate" $(CASE) $(ENGINE) $(BASE)
	@touch $@

$(OUT)/locate.txt: $(BASE)/posterior.txt
	@gl-gap-locate $(COMMON) -w $(BASE)/posterior-weights.txt $(BASE)/ensemble.txt -o $@ 2>$(OUT)/locate.log \
	 || { cat $(OUT)/locate.log >&2; exit 2; }
	@cat $(OUT)/locate.log >&2

$(OUT)/attribution.txt: $(BASE)/posterior.txt
	@"$(SCRIPTS)attribute" $(CASE) $(ENGINE) $(OUT)

# Those of the winner's effects that are the simulator's; what the measurement does needs no runs.
$(OUT)/winner.txt: $(OUT)/attribution.txt
	@awk -f "$(SCRIPTS)winner.awk" $(PARAMS) $< >$(OUT)/.winner.txt.part
	@mv $(OUT)/.winner.txt.part $@

$(OUT)/shrink.txt: $(OUT)/winner.txt $(BASE)/posterior.txt
	@effects=$$(cat $<); \
	 if [ -z "$$effects" ]; then \
	     echo "diagnose: no effect of the simulator explains the gap, so none is put in" >&2; \
	     printf 'observable\tgap_before\tgap_after\tfloor\tshrink\tshrink_low\tshrink_high\n' >$(OUT)/.shrink.txt.part; \
	     rm -f $(OUT)/shrink-unseen.txt; \
	     mv $(OUT)/.shrink.txt.part $@; \
	     exit; \
	 fi; \
	 after=$(AFTER)-$$effects; \
	 EFFECTS=$$effects "$(SCRIPTS)calibrate" $(CASE) $(ENGINE) $$after || exit; \
	 shrink() { \
	     gl-gap-shrink $(COMMON) $(call option,--scatter,$(SCATTER)) --before $(BASE)/ensemble.txt,$(BASE)/posterior-weights.txt \
	      --after $$after/ensemble.txt,$$after/posterior-weights.txt "$$@" 2>$(OUT)/shrink.log || { cat $(OUT)/shrink.log >&2; exit 2; }; \
	     cat $(OUT)/shrink.log >&2; \
	 }; \
	 $(if $(STEPS),shrink --calibrated $(STEPS) -o $(OUT)/shrink-unseen.txt; mv $(OUT)/shrink.log $(OUT)/shrink-unseen.log;) \
	 shrink -o $@
