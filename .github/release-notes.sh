#!/bin/sh
# Prints the notes of a release: its entry in CHANGELOG.md.
# Fails unless TAG is the version of Cargo.toml, and the entry is there and dated.
#
#   release-notes.sh v0.2.0 > notes.md
set -eu
tag=$1
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
if [ "$tag" != "v$version" ]; then
  echo "release-notes: the tag $tag is not the version of Cargo.toml, $version" >&2
  exit 1
fi
head=$(grep -F "## [$version]" CHANGELOG.md || true)
case "$head" in
  *[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]) ;;
  '') echo "release-notes: CHANGELOG.md has no entry for $version" >&2; exit 1 ;;
  *) echo "release-notes: CHANGELOG.md has no date: $head" >&2; exit 1 ;;
esac
# From the line below its heading to the next heading of that level.
awk -v head="$head" '/^## / { inside = ($0 == head); next } inside' CHANGELOG.md
