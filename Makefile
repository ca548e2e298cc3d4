# make demo    what posing does, on a real take: installs what is missing, builds, restores, writes a page to look at
# make test    the tests: installs what is missing, then cargo test
# The rest is for developers; see README.md.

CARGO  ?= cargo
PREFIX ?= /usr/local
BIN    := target/release
# The path of the CMU takes (a folder NN/ a subject with NN.asf and NN_*.amc), for `make model` and `make tables`.
CMU    ?=
# make tables QUICK=1: a few frames of a few subjects.
QUICK  ?=

ON_PATH  := amc2xyz cluster ksvd-train dict-concat denoise complete xyz2bvh
BESIDE   := bvh2xyz xyz2amc prior-train encode decode corrupt score evaluate plot model

.PHONY: demo test build needs model tables bench bench-peers scale bless install uninstall clean

demo: needs build
	@POSING_BIN=$(BIN) sh testdata/examples/demo.sh target/demo

test: needs
	$(CARGO) test --release

build: needs
	$(CARGO) build --release

# The system's packages, where they are missing.
needs:
	@sh .ci/needs

# Learns the built-in model from the CMU takes: every fourth frame of every take.
model: build
	@test -n "$(CMU)" || { echo 'make model: name the CMU takes: make model CMU=path' >&2; exit 2; }
	@POSING_BIN=$(BIN) sh testdata/examples/builtin.sh "$(CMU)" src/prior/builtin.npz

# The paper's Tables 1 to 4 again, with a report of every run: target/tables/tables.html. What is done is not done again.
tables: build
	@POSING_BIN=$(BIN) sh testdata/examples/tables.sh $(if $(QUICK),--quick) \
	  "$(or $(CMU),$(wildcard ../shared/data/cmu))" target/tables$(if $(QUICK),-quick)

bench: needs
	$(CARGO) bench --bench speed --bench coding --bench latency --bench growth

# posing beside SPAMS, scikit-learn, pyarrow and NumPy, which it fetches into an environment of its own.
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

# 2,075,000 poses to 262,759 atoms. make scale QUICK=1: a hundredth of it.
scale: needs
	$(CARGO) bench --bench scale -- $(if $(QUICK),--quick)

# Writes pages of the manual and goldens anew, on purpose: look at the difference before you commit it.
bless: needs
	POSING_BLESS=1 $(CARGO) test --release

install: build
	install -d "$(DESTDIR)$(PREFIX)/bin" "$(DESTDIR)$(PREFIX)/libexec/posing" \
	  "$(DESTDIR)$(PREFIX)/share/man/man1" "$(DESTDIR)$(PREFIX)/share/man/man5" \
	  "$(DESTDIR)$(PREFIX)/share/bash-completion/completions" \
	  "$(DESTDIR)$(PREFIX)/share/zsh/site-functions" "$(DESTDIR)$(PREFIX)/share/fish/vendor_completions.d"
	install -m 755 $(addprefix $(BIN)/,posing $(ON_PATH)) "$(DESTDIR)$(PREFIX)/bin"
	install -m 755 $(addprefix $(BIN)/,$(BESIDE)) "$(DESTDIR)$(PREFIX)/libexec/posing"
	install -m 644 man/*.1 "$(DESTDIR)$(PREFIX)/share/man/man1"
	install -m 644 man/*.5 "$(DESTDIR)$(PREFIX)/share/man/man5"
	$(BIN)/posing completions bash > "$(DESTDIR)$(PREFIX)/share/bash-completion/completions/posing"
	$(BIN)/posing completions zsh > "$(DESTDIR)$(PREFIX)/share/zsh/site-functions/_posing"
	$(BIN)/posing completions fish > "$(DESTDIR)$(PREFIX)/share/fish/vendor_completions.d/posing.fish"

uninstall:
	cd "$(DESTDIR)$(PREFIX)" && rm -rf libexec/posing && rm -f $(addprefix bin/,posing $(ON_PATH)) \
	  share/bash-completion/completions/posing share/zsh/site-functions/_posing share/fish/vendor_completions.d/posing.fish
	for page in man/*.1; do rm -f "$(DESTDIR)$(PREFIX)/share/man/man1/$${page#man/}"; done
	for page in man/*.5; do rm -f "$(DESTDIR)$(PREFIX)/share/man/man5/$${page#man/}"; done

clean:
	$(CARGO) clean
