#!/bin/sh
# Tests archive.sh and release-notes.sh, with a stand-in for the program.
set -eu
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "test-release: $*" >&2; exit 1; }

# A program that has a command for each manual page, and two of them linked.
mkdir "$work/bin"
cat > "$work/bin/posing" <<'END'
#!/bin/sh
case "$*" in
  'list --linked') printf '%s\n' amc2xyz denoise ;;
  list) for page in man/*.1; do basename "$page" .1; done | grep -vx posing ;;
  completions*) echo "# $*" ;;
  *) exit 2 ;;
esac
END
chmod +x "$work/bin/posing"
for page in man/*.1; do
  command=$(basename "$page" .1)
  [ "$command" = posing ] || cp "$work/bin/posing" "$work/bin/$command"
done

mkdir -p target
[ -e target/third-party.txt ] || echo licenses > target/third-party.txt
archive=$(sh .github/archive.sh some-target "$work/bin" "$work/out")
[ "$(ls "$work/out")" = "$(basename "$archive")" ] || fail "left beside the archive: $(ls "$work/out")"
mkdir "$work/prefix"
tar -xzf "$archive" -C "$work/prefix" --strip-components 1
cd "$work/prefix"
for file in README.md CHANGELOG.md LICENSE LICENSE-MIT LICENSE-APACHE third-party.txt bin/posing bin/amc2xyz bin/denoise \
    share/man/man1/posing.1 share/man/man1/posing-complete.1 share/man/man5/posing-table.5 \
    share/man/man7/posing-formats.7 share/bash-completion/completions/posing share/bash-completion/completions/denoise \
    share/zsh/site-functions/_posing share/fish/vendor_completions.d/posing.fish; do
  [ -s "$file" ] || fail "$file is not in the archive"
done
for file in bin/*; do [ -x "$file" ] || fail "$file cannot be run"; done
[ ! -e bin/complete ] || fail 'bin/complete would hide a builtin of bash'
find . -type l | while read -r link; do [ -e "$link" ] || fail "$link leads nowhere"; done
cd - > /dev/null

mkdir "$work/notes"
notes() { (cd "$work/notes" && sh "$OLDPWD/.github/release-notes.sh" "$1" 2>&1); }
printf '[package]\nversion = "1.2.3"\n\n[dependencies]\nother = { version = "9" }\n' > "$work/notes/Cargo.toml"
printf '# Changelog\n\n## [1.2.3] - 2030-01-31\n\n- New.\n\n## [1.2.2] - 2029-12-31\n\n- Old.\n' > "$work/notes/CHANGELOG.md"
[ "$(notes v1.2.3)" = "$(printf '\n- New.\n')" ] || fail "notes: $(notes v1.2.3)"
if notes v1.2.2 > /dev/null; then fail 'a tag of another version passes'; fi
if notes 1.2.3 > /dev/null; then fail 'a tag without v passes'; fi
sed -i.bak 's/^## \[1.2.3\].*/## [1.2.3] (unreleased)/' "$work/notes/CHANGELOG.md"
if notes v1.2.3 > /dev/null; then fail 'an entry without a date passes'; fi
sed -i.bak '/1\.2\.3/d' "$work/notes/CHANGELOG.md"
if notes v1.2.3 > /dev/null; then fail 'no entry passes'; fi
echo 'test-release: all is well'
