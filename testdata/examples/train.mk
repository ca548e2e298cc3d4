# Trains a dictionary in parts with make, by the steps of train.sh, which has the other variables, too:
#
#     make -j2 -f train.mk K=8 POSES='my poses.csv'
#
# Copy train.sh with this file. -j says how many parts are trained at a time, on a thread each. Run it again after a failure.
K ?= 8
DICT ?= dict.npz
export K DICT

# The other parts are trained even if one fails.
MAKEFLAGS += -k
parts := $(shell seq 0 $$(($(K) - 1)))

$(DICT): $(parts:%=part-%)
	@sh train.sh join
$(parts:%=part-%): part-%: split
	@sh train.sh part $*
split:
	@sh train.sh split
.PHONY: $(DICT) split $(parts:%=part-%)
