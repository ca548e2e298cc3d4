# make demo    restores a damaged run: installs what is missing, builds, restores, writes an HTML page
# make test    runs the tests: installs what is missing, then cargo test; lists skipped tests at the end
# make lint    checks formatting, clippy and documentation for warnings
# make wheel   builds the Python wheel, with the program in it
# The rest is for developers; see CONTRIBUTING.md.

CARGO  ?= cargo
PREFIX ?= /usr/local
BIN    := target/release
# The folder of the CMU takes, with a folder NN for each subject (NN.asf, NN_*.amc), for `make model` and `make tables`.
CMU    ?=
# make tables QUICK=1: a few frames of a few subjects.
QUICK  ?=

# What `posing --version` names beside the version; nothing outside a checkout.
export POSING_COMMIT := $(shell [ -e .git ] && git rev-parse --short=7 HEAD 2>/dev/null)

.PHONY: demo test lint build needs model tables bench bench-peers scale fuzz test-slurm bless install uninstall wheel release clean

demo: build
	@$(BIN)/posing demo target/demo

test: needs
	@rm -f target/skipped-tests
	$(CARGO) test --release
	@if [ -s target/skipped-tests ]; then sort -u target/skipped-tests | \
	  { echo; echo "Skipped:"; sed 's/^/  /'; }; fi

lint: needs
	$(CARGO) fmt --all --check
	$(CARGO) clippy --all-targets -- -D warnings
	$(CARGO) clippy --lib --no-default-features -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --no-deps

# The program, and beside it a link for each command.
build: needs
	$(CARGO) build --release
	@set -e; for name in $$($(BIN)/posing list); do \
	  [ "$$(readlink $(BIN)/$$name)" = posing ] || ln -sf posing $(BIN)/$$name; \
	done

# Installs missing system packages.
needs:
	@sh .ci/needs

# Trains the built-in model on every fourth frame of the CMU takes, and the prior of rotations.
model: build
	@test -n "$(CMU)" || { echo 'make model: name the CMU takes: make model CMU=path' >&2; exit 2; }
	@POSING_BIN=$(BIN) sh testdata/examples/builtin.sh "$(CMU)" crates/models/src/prior/builtin.npz crates/models/src/prior/rotations.npz

# Measures Lai et al.'s Tables 1 to 4: target/tables/tables.html, and a report of every run. Finished results are kept.
tables: build
	@POSING_BIN=$(BIN) sh testdata/examples/tables.sh $(if $(QUICK),--quick) \
	  "$(or $(CMU),$(wildcard ../shared/data/cmu))" target/tables$(if $(QUICK),-quick)

bench: needs
	$(CARGO) bench --bench speed --bench coding --bench latency --bench growth --bench metric --bench registration --bench editing --bench solving

# Compares with SPAMS, scikit-learn, pyarrow and NumPy, installed into a virtual environment.
PEERS := target/peers
bench-peers: build
	@test -d "$(or $(CMU),../shared/data/cmu)/01" || \
	  { echo 'make bench-peers: subject 01 is needed; name the CMU takes: make bench-peers CMU=path' >&2; exit 2; }
	@$(MAKE) --no-print-directory $(PEERS)/ready
	$(PEERS)/bin/python tests/bench/peers.py $(BIN) "$(or $(CMU),../shared/data/cmu)" $(if $(QUICK),--quick)

$(PEERS)/ready:
	python3 -m venv $(PEERS)
	$(PEERS)/bin/pip install -q numpy scikit-learn spams-bin pyarrow
	touch $@

# 2,075,000 poses to 262,759 atoms. make scale POSES=20000: a hundredth of it.
scale: needs
	$(CARGO) bench --bench scale -- $(if $(POSES),--poses $(POSES))

# Gives the readers broken files, MINUTES for each target, with cargo-fuzz: see tests/fuzz/README.md.
MINUTES ?= 1
TARGETS ?= $(basename $(notdir $(wildcard tests/fuzz/fuzz_targets/*.rs)))
fuzz: needs
	set -e; for target in $(TARGETS); do mkdir -p tests/fuzz/corpus/$$target; \
	  $(CARGO) +nightly fuzz run --fuzz-dir tests/fuzz $$target tests/fuzz/corpus/$$target tests/fuzz/seeds/$$target -- \
	    -max_total_time=$$((60 * $(MINUTES))) -max_len=65536 -timeout=10 -rss_limit_mb=2048 -malloc_limit_mb=1024; \
	done

# Runs the Slurm examples on a cluster that this starts; needs root, slurm-wlm and munge.
test-slurm: build
	@sh tests/slurm/run.sh

# Writes the manual pages again: read the diff before you commit it.
bless: needs
	POSING_BLESS=1 $(CARGO) test --release

# `posing` goes into bin, with links for the commands whose names no shell owns.
ROOT := $(DESTDIR)$(PREFIX)
EXAMPLES := $(addprefix testdata/examples/,clean.mk nightly.cron train.sh train.mk train.parallel.sh train.slurm evaluate.slurm)
install: build
	install -d "$(ROOT)/bin" "$(ROOT)/share/man/man1" "$(ROOT)/share/man/man5" "$(ROOT)/share/man/man7" \
	  "$(ROOT)/share/bash-completion/completions" "$(ROOT)/share/zsh/site-functions" \
	  "$(ROOT)/share/fish/vendor_completions.d" "$(ROOT)/share/doc/posing/examples"
	# Earlier versions kept a program for each command there.
	rm -rf "$(ROOT)/libexec/posing"
	install -m 644 $(EXAMPLES) "$(ROOT)/share/doc/posing/examples"
	install -m 755 $(BIN)/posing "$(ROOT)/bin"
	install -m 644 man/posing.1 "$(ROOT)/share/man/man1"
	install -m 644 man/*.5 "$(ROOT)/share/man/man5"
	install -m 644 man/*.7 "$(ROOT)/share/man/man7"
	set -e; for name in $$($(BIN)/posing list); do \
	  install -m 644 man/$$name.1 "$(ROOT)/share/man/man1/posing-$$name.1"; \
	done
	set -e; for name in $$($(BIN)/posing list --linked); do \
	  ln -sf posing "$(ROOT)/bin/$$name"; \
	done
	set -e; for name in '' $$($(BIN)/posing list --linked); do file=$${name:-posing}; \
	  $(BIN)/posing completions bash $$name > "$(ROOT)/share/bash-completion/completions/$$file"; \
	  $(BIN)/posing completions zsh $$name > "$(ROOT)/share/zsh/site-functions/_$$file"; \
	  $(BIN)/posing completions fish $$name > "$(ROOT)/share/fish/vendor_completions.d/$$file.fish"; \
	done

# Removes what `make install` wrote: the links are those that lead to posing.
uninstall:
	cd "$(ROOT)" && for name in bin/*; do case "$$(readlink "$$name")" in posing | ../libexec/posing/*) \
	  file=$${name#bin/}; rm -f "$$name" "share/bash-completion/completions/$$file" \
	    "share/zsh/site-functions/_$$file" "share/fish/vendor_completions.d/$$file.fish" ;; esac; done
	cd "$(ROOT)" && rm -rf libexec/posing share/doc/posing && rm -f bin/posing share/man/man1/posing.1 share/man/man1/posing-*.1 \
	  share/bash-completion/completions/posing share/zsh/site-functions/_posing \
	  share/fish/vendor_completions.d/posing.fish
	for page in man/*.[57]; do rm -f "$(ROOT)/share/man/man$${page##*.}/$${page#man/}"; done

# What a release ships for this kind of machine, into target/wheels and target/archive: a wheel; an archive and a .deb of
# the program, which on Linux is static; checksums.
wheel:
	@sh .github/wheel.sh

release:
	@sh .github/release.sh

clean:
	$(CARGO) clean
