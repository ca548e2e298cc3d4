# Learns a dictionary from parts/*.csv (made by: posing cluster -k 8 --split parts poses.csv), one part a job:
#
#     cp train.mk Makefile && make -j2 dict.npz
#
# A part is learnt anew only when its table changed. A run that was stopped goes on from its checkpoint.
POSING  ?= posing
# As many atoms a part as this RMS error (cm) asks for, so that small parts get small dictionaries.
ERROR   ?= 1
ROUNDS  ?= 20
PARTS   := $(wildcard parts/*.csv)

dict.npz: $(PARTS:.csv=.npz)
	@test -n "$(PARTS)" || { echo 'train.mk: no parts/*.csv; make them with: posing cluster -k 8 --split parts poses.csv' >&2; exit 2; }
	$(POSING) dict-concat --prune 0.999 -o $@ $^

# One thread each: the jobs of make are the parallelism.
parts/%.npz: parts/%.csv
	$(POSING) ksvd-train --error $(ERROR) --iterations $(ROUNDS) --threads 1 --checkpoint $@.checkpoint --log $(@:.npz=.jsonl) -o $@ $<
	rm -f $@.checkpoint

.PHONY: clean
clean:
	rm -f dict.npz parts/*.npz parts/*.npz.checkpoint parts/*.jsonl
