# Cleans every capture of a folder, a file a rule: make -j2 [CAPTURES=captures] [CLEANED=cleaned]
# Exit code 3 says that a result has findings: it is there, and its record says which.
CAPTURES = captures
CLEANED = cleaned
POSING = posing
FLAGS = --fps 120 --up y

takes := $(wildcard $(CAPTURES)/*.c3d $(CAPTURES)/*.trc $(CAPTURES)/*.amc $(CAPTURES)/*.bvh $(CAPTURES)/*.csv)

all: $(takes:$(CAPTURES)/%=$(CLEANED)/%)

$(CLEANED)/%: $(CAPTURES)/%
	@mkdir -p $(CLEANED)
	$(POSING) clean $(FLAGS) $< -o $@ || [ $$? = 3 ]
	@touch $@
.PHONY: all
